"""The kernel and the load as printed, eqs (2) to (4), (18) and (19), each against a check."""

from __future__ import annotations

from functools import partial

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import cylinder_stress, kernel, make_problem
from taction.netlist_gen.scene.problem import CylinderLoad
from taction.system.array_types import Floats
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    weigh,
)
from taction.verification.evidence.paper.tactile import Geometry, largest_difference

POISSON = (0.1, 0.3, 0.5)
SAME = 1e-12
OFFSETS = np.linspace(-4.0, 4.0, 161)
FAR = 1e4  # half of a wide range for the mean of the kernel

corrected = partial(kernel, depth=1.0, modulus=1.0)


def kernels(quick: bool) -> Chapter:
    """Judge the printed kernels and load."""
    return Chapter(
        (_normal(), _special_case(), _tangential(), _symmetric(), _weights(), _load(), _mean(),
         _resistors())
    )  # fmt: skip


def _printed(offset: Floats, nu: float) -> Floats:
    """Return the kernel of eq (2) as printed, with x = E = 1."""
    return np.asarray(
        2.0 * ((1 - nu) ** 2 - nu * (nu + 1) * offset**2) / (np.pi * (1 + offset**2) ** 2)
    )


def _plane_strain(offset: Floats, nu: float) -> Floats:
    """Return the strain under a line force, from its stresses (Flamant) and Hooke's law.

    ``sigma_x = 2 x³ / (pi r⁴)``, ``sigma_y = 2 x y² / (pi r⁴)`` per unit of compressive force,
    and in plane strain ``E e_x = (1 - nu²) sigma_x - nu (1 + nu) sigma_y``.
    """
    r4 = (1.0 + offset**2) ** 2
    along, across = 2.0 / (np.pi * r4), 2.0 * offset**2 / (np.pi * r4)
    return np.asarray((1.0 - nu**2) * along - nu * (1.0 + nu) * across)


def _compared(expected: Floats, printed: Floats, right: Floats) -> dict[str, float]:
    """Return how far the printed and the corrected kernel are from `expected`."""
    return {
        "printed": largest_difference(printed, expected),
        "corrected": largest_difference(right, expected),
    }


def _normal() -> Finding:
    each = [
        _compared(_plane_strain(OFFSETS, nu), _printed(OFFSETS, nu), corrected(OFFSETS, poisson=nu))
        for nu in POISSON
    ]
    values = {name: max(errors[name] for errors in each) for name in each[0]}
    wrong = [errors["printed"] for errors in each]
    return finding("eq-2", values, weigh(max(wrong) <= SAME), nu=POISSON, wrong=wrong)


def _special_case() -> Finding:
    special = 1.5 / np.pi * (1 - OFFSETS**2) / (1 + OFFSETS**2) ** 2
    values = _compared(special, _printed(OFFSETS, 0.5), corrected(OFFSETS, poisson=0.5))
    return finding("eq-19", values, weigh(values["corrected"] <= SAME))


def _tangential() -> Finding:
    expected = OFFSETS * _plane_strain(OFFSETS, 0.5)
    right = corrected(OFFSETS, poisson=0.5, tangential=True)
    values = _compared(expected, OFFSETS * _printed(OFFSETS, 0.5), right)
    return finding("eq-3", values, weigh(values["printed"] <= SAME))


def _symmetric() -> Finding:
    y = Geometry(9, 4.0).y
    T = corrected(y[:, None] - y[None, :], poisson=0.5, tangential=True)
    skew = largest_difference(T, -T.T)
    sigma = np.linalg.svd(T, compute_uv=False)
    values = {"skew": skew, "least_singular_value": float(sigma[-1] / sigma[0])}
    return finding("kernel-symmetric", values, weigh(skew > 0.1, skew <= SAME))


def _weights() -> Finding:
    sizes = (26, 51, 101, 201)
    grids = [Geometry(N, 6.0) for N in sizes]
    norms = [float(np.linalg.norm(grid.matrix, 2)) for grid in grids]
    weighted = [norm * grid.spacing for norm, grid in zip(norms, grids, strict=True)]
    spread = max(weighted) / min(weighted) - 1.0
    values = {"first": norms[0], "last": norms[-1], "weighted_spread": spread}
    outcome = weigh(norms[-1] < 1.5 * norms[0], spread < 0.05)
    return finding("eq-4", values, outcome, sizes=sizes, norms=norms, weighted=weighted)


def _load() -> Finding:
    # y = a sin(theta) makes the integrand smooth, so the trapezoidal rule is exact.
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 201)
    values = {}
    for name, normalised in (("printed", False), ("hertz", True)):
        load = CylinderLoad(kind="cylinder", force=3.0, half_width=1.0, normalised=normalised)
        stress = cylinder_stress(np.sin(theta), load) * np.cos(theta)
        values[name] = float(np.trapezoid(stress, theta))
    return finding("eq-18", values, weigh(abs(values["printed"] - 3.0) <= 1e-9))


def _integral(edge: float) -> float:
    """Return the integral of eq (19) from -`edge` to `edge`: 1.5/pi y/(1 + y²) is primitive."""
    return 2 * 1.5 / np.pi * (edge / (1 + edge**2))


def _mean() -> Finding:
    fine = np.linspace(-40.0, 40.0, 400_001)
    numeric = float(np.trapezoid(corrected(fine, poisson=0.5), fine))
    closed, tail = _integral(40.0), _integral(FAR)
    outcome = weigh(tail > 1e-2, abs(numeric - closed) < 1e-6)
    return finding("kernel-mean", {"at_40": numeric, "closed_form": closed}, outcome, tail=tail)


def _resistors() -> Finding:
    scene = paper_scene("paper-breadboard")
    ohms = synthesise(scene, make_problem(scene)).forward_ohms
    absent = int(np.sum(~np.isfinite(ohms)))
    return finding("resistors", {"absent": float(absent)}, weigh(absent == 0, absent == 12))
