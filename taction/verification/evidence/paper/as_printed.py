"""Kernel, load and network as printed, eqs (2) to (21), each against a check."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import cylinder_stress, kernel, make_problem
from taction.netlist_gen.scene.problem_keys import CylinderLoad
from taction.system.array_types import Floats
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    weigh,
)
from taction.verification.evidence.paper.tactile import Geometry, difference, unit_network
from taction.verification.reference.ideal_answer import ideal_linear
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve

POISSON = (0.1, 0.3, 0.5)
SAME, CLOSE = 1e-12, 1e-9
OFFSETS = np.linspace(-4.0, 4.0, 161)
SIZES = (26, 51, 101, 201)
FAR = 1e4  # half of a wide range for the mean of the kernel
GEOMETRY = Geometry(9, 4.0)
R, S = 0.25, 3.0  # neither is 1, so that a missing factor shows

corrected = partial(kernel, depth=1.0, modulus=1.0)


def kernels(quick: bool) -> Chapter:
    """Judge the printed kernels and load."""
    return Chapter((*_strain(), *_matrix(), _load(), _mean()))


def _printed(offset: Floats, nu: float) -> Floats:
    """Return the kernel of eq (2) as printed, with x = E = 1."""
    return np.asarray(
        2.0 * ((1 - nu) ** 2 - nu * (nu + 1) * offset**2) / (np.pi * (1 + offset**2) ** 2)
    )


def _plane_strain(offset: Floats, nu: float) -> Floats:
    """Return the strain under a line force, from its stresses (Flamant) and Hooke's law."""
    r4 = (1.0 + offset**2) ** 2
    along, across = 2.0 / (np.pi * r4), 2.0 * offset**2 / (np.pi * r4)
    return np.asarray((1.0 - nu**2) * along - nu * (1.0 + nu) * across)


def _off(expected: Floats, printed: Floats, right: Floats) -> dict[str, float]:
    """Return how far the printed and the corrected kernel are from `expected`."""
    return {"printed": difference(printed, expected), "corrected": difference(right, expected)}


def _strain() -> tuple[Finding, ...]:
    """Judge the kernels for normal and tangential stress, and that for nu = 0.5."""
    y = OFFSETS
    each = [_off(_plane_strain(y, nu), _printed(y, nu), corrected(y, poisson=nu)) for nu in POISSON]
    normal = {name: max(off[name] for off in each) for name in each[0]}
    wrong = [off["printed"] for off in each]
    known = 1.5 / np.pi * (1 - y**2) / (1 + y**2) ** 2
    special = _off(known, _printed(y, 0.5), corrected(y, poisson=0.5))
    right = corrected(y, poisson=0.5, tangential=True)
    tangential = _off(y * _plane_strain(y, 0.5), y * _printed(y, 0.5), right)
    return (
        finding("eq-2", weigh(normal["printed"] <= SAME), **normal, nu=POISSON, wrong=wrong),
        finding("eq-19", weigh(special["corrected"] <= SAME), **special),
        finding("eq-3", weigh(tangential["printed"] <= SAME), **tangential),
    )


def _matrix() -> tuple[Finding, ...]:
    """Judge the discretisation, the symmetry of the kernel, and the resistors of a board."""
    y = GEOMETRY.y
    T = corrected(y[:, None] - y[None, :], poisson=0.5, tangential=True)
    sigma, skew = np.linalg.svd(T, compute_uv=False), difference(T, -T.T)
    least = float(sigma[-1] / sigma[0])
    grids = [Geometry(N, 6.0) for N in SIZES]
    norms = [float(np.linalg.norm(grid.matrix, 2)) for grid in grids]
    weighted = [norm * grid.spacing for norm, grid in zip(norms, grids, strict=True)]
    spread = max(weighted) / min(weighted) - 1.0
    found = {"first": norms[0], "last": norms[-1], "weighted_spread": spread}
    lists = {"sizes": SIZES, "norms": norms, "weighted": weighted}
    scene = paper_scene("paper-breadboard")
    absent = float(np.sum(~np.isfinite(synthesise(scene, make_problem(scene)).forward_ohms)))
    symmetric = weigh(skew > 0.1, skew <= SAME)
    return (
        finding("kernel-symmetric", symmetric, skew=skew, least_singular_value=least),
        finding("eq-4", weigh(norms[-1] < 1.5 * norms[0], spread < 0.05), **found, **lists),
        finding("resistors", weigh(absent == 0, absent == 12), absent=absent),
    )


def _load() -> Finding:
    # y = a sin(theta) makes the integrand smooth, so the trapezoidal rule is exact.
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 201)
    printed, hertz = (
        float(np.trapezoid(cylinder_stress(np.sin(theta), load) * np.cos(theta), theta))
        for load in (
            CylinderLoad(kind="cylinder", force=3.0, half_width=1.0, normalised=normalised)
            for normalised in (False, True)
        )
    )
    return finding("eq-18", weigh(abs(printed - 3.0) <= CLOSE), printed=printed, hertz=hertz)


def _mean() -> Finding:
    """Integrate eq (19) over a range; 1.5/pi y/(1 + y²) is primitive."""
    closed, tail = (3.0 / np.pi * edge / (1.0 + edge**2) for edge in (40.0, FAR))
    fine = np.linspace(-40.0, 40.0, 400_001)
    numeric = float(np.trapezoid(corrected(fine, poisson=0.5), fine))
    outcome = weigh(tail > 1e-2, abs(numeric - closed) < 1e-6)
    return finding("kernel-mean", outcome, at_40=numeric, closed_form=closed, tail=tail)


def equations(quick: bool) -> Chapter:
    """Judge what the printed equations say of the network's rest."""
    T, strain = GEOMETRY.matrix, GEOMETRY.strain(1, 0.01)
    printed = _gradient(2.0 / S, T, strain, bias=False)  # eq (9), without R and bias current
    off = {f"at_{k}": _gradient(k / (S * R), T, strain) for k in (1, 2, 4)}
    right, others = off["at_2"], min(off["at_1"], off["at_4"])
    network = unit_network(T, strain, 1.0 / (S * R), "linear")
    response = ideal_linear(network, np.zeros(GEOMETRY.channels))
    rest = response.outputs(response.time[-1:])[0]
    ridges = [T.T @ T + factor / (S * R) * np.eye(len(rest)) for factor in (2.0, 1.0)]
    twice, once = (difference(np.asarray(np.linalg.solve(A, T.T @ strain)), rest) for A in ridges)
    findings = (
        finding("eq-9", weigh(printed <= CLOSE), printed=printed, corrected=right, R=R, s=S),
        finding("eq-16", weigh(right <= CLOSE and others > 0.01), **off),
        finding("eq-21", weigh(twice <= CLOSE), printed=twice, corrected=once),
        _path(T, strain),
    )
    return Chapter(findings)


def _gradient(lam: float, T: Floats, strain: Floats, *, bias: bool = True) -> float:
    """Return ``‖∂P/∂u‖`` of eq (16) over its largest term at the minimum of eq (8) with `lam`."""
    u = solve(Problem(T, strain, lam, "exponential", bias)).u
    terms = (np.log(u) + 1.0) / R
    return float(np.max(np.abs(S * T.T @ (T @ u - strain) + terms)) / np.max(np.abs(terms)))


def _path(T: Floats, strain: Floats) -> Finding:
    """Integrate the currents round a closed rectangle, over v and over u = exp(v)."""
    points, weights = np.polynomial.legendre.leggauss(20)
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    over_v = over_u = size = 0.0
    for a, b in pairwise(corners):
        for point, weight in zip(points.tolist(), weights.tolist(), strict=True):
            v, along = np.zeros((2, GEOMETRY.channels))
            v[:2] = a + 0.5 * (1.0 + point) * (b - a)
            along[:2] = 0.5 * weight * (b - a)
            current = -(v + 1.0) / R - S * T.T @ (T @ np.exp(v) - strain)
            over_v += float(current @ along)
            over_u += float(current @ (np.exp(v) * along))
            size += abs(float(current @ along))
    in_v, in_u = abs(over_v) / size, abs(over_u) / size
    return finding("eq-10", weigh(in_v <= CLOSE), over_v=in_v, over_u=in_u)
