"""The kernel and the load as printed, eqs (2) to (4), (18) and (19), each against a check."""

from __future__ import annotations

import numpy as np

from netlist_gen.board.synthesis import synthesise
from netlist_gen.problem.inverse_problem import cylinder_stress, kernel, make_problem
from netlist_gen.scene.problem import CylinderLoad
from spice_models.array_types import Floats
from verification.studies.paper.findings import Chapter, Finding, listed, paper_scene, weigh
from verification.studies.paper.tactile import Geometry

POISSON = (0.1, 0.3, 0.5)
SAME = 1e-12
OFFSETS = np.linspace(-4.0, 4.0, 161)


def kernels(quick: bool) -> Chapter:
    """Judge the printed kernels and load."""
    return Chapter((_normal(), _special_case(), *_tangential(), _weights(), _load(), *_zeros()))


def _printed(offset: Floats, nu: float) -> Floats:
    """Return the kernel of eq (2) as it is printed, x = E = 1."""
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


def _ours(offset: Floats, nu: float) -> Floats:
    return kernel(offset, depth=1.0, modulus=1.0, poisson=nu)


def _off(a: Floats, b: Floats) -> float:
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def _normal() -> Finding:
    wrong = [_off(_printed(OFFSETS, nu), _plane_strain(OFFSETS, nu)) for nu in POISSON]
    right = max(_off(_ours(OFFSETS, nu), _plane_strain(OFFSETS, nu)) for nu in POISSON)
    return Finding(
        "eq-2",
        "eq (2) against Flamant's stresses with Hooke's law in plane strain, nu ="
        f" {listed(POISSON)}",
        f"off by {listed([100 * w for w in wrong])} % of its peak; with (1 - nu²) x² in place of"
        f" (1 - nu)² x² by {right:.0e}",
        weigh(max(wrong) <= SAME),
        {"printed": max(wrong), "corrected": right},
    )


def _special_case() -> Finding:
    special = 1.5 / np.pi * (1 - OFFSETS**2) / (1 + OFFSETS**2) ** 2
    wrong, right = (_off(k(OFFSETS, 0.5), special) for k in (_printed, _ours))
    return Finding(
        "eq-19",
        "eq (19) against eq (2) at nu = 0.5",
        f"equal to {right:.0e} with (1 - nu²); the printed eq (2) is off by {100 * wrong:.2g} %",
        weigh(right <= SAME),
        {"printed": wrong, "corrected": right},
    )


def _tangential() -> tuple[Finding, Finding]:
    def printed(z: Floats) -> Floats:
        return np.asarray(z * _printed(z, 0.5))

    def ours(z: Floats) -> Floats:
        return kernel(z, depth=1.0, modulus=1.0, poisson=0.5, tangential=True)

    wanted = OFFSETS * _plane_strain(OFFSETS, 0.5)
    wrong, right = _off(printed(OFFSETS), wanted), _off(ours(OFFSETS), wanted)
    y = Geometry("", 9, 4.0).y
    T = ours(y[:, None] - y[None, :])
    skew = float(np.max(np.abs(T + T.T)) / np.max(np.abs(T)))
    sigma = np.linalg.svd(T, compute_uv=False)
    return (
        Finding(
            "eq-3",
            "eq (3) against y/x times the same strain, nu = 0.5",
            f"off by {100 * wrong:.3g} % of its peak, the corrected one by {right:.0e}",
            weigh(wrong <= SAME),
            {"printed": wrong, "corrected": right},
        ),
        Finding(
            "kernel-symmetric",
            "k(t, s) = k(s, t) for the tangential kernel, T of nine channels",
            f"‖T + Tᵀ‖ / ‖T‖ = {skew:.0e}: skew, and singular for every odd N (least singular value"
            f" {sigma[-1] / sigma[0]:.0e} of the largest). Condition: the normal kernel",
            weigh(skew > 0.1, skew <= SAME),
            {"skew": skew, "least_singular_value": float(sigma[-1] / sigma[0])},
        ),
    )


def _weights() -> Finding:
    sizes = (26, 51, 101, 201)
    grids = [Geometry("", N, 6.0) for N in sizes]
    norms = [float(np.linalg.norm(grid.matrix, 2)) for grid in grids]
    weighted = [norm * grid.spacing for norm, grid in zip(norms, grids, strict=True)]
    spread = max(weighted) / min(weighted) - 1.0
    return Finding(
        "eq-4",
        f"‖T‖ for N = {listed(sizes)} over the same range",
        f"{listed(norms)}; times the spacing {listed(weighted)}: without it N changes the problem."
        " Condition: with the spacing as a weight (quadrature = 'rectangle')",
        weigh(norms[-1] < 1.5 * norms[0], spread < 0.05),
        {"first": norms[0], "last": norms[-1], "weighted_spread": spread},
    )


def _load() -> Finding:
    # y = a sin(theta) makes the integrand smooth, so the trapezoidal rule is exact.
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 201)
    forces = []
    for normalised in (False, True):
        load = CylinderLoad(kind="cylinder", force=3.0, half_width=1.0, normalised=normalised)
        stress = cylinder_stress(np.sin(theta), load) * np.cos(theta)
        forces.append(float(np.trapezoid(stress, theta)))
    return Finding(
        "eq-18",
        "integral of eq (18) with p = 3",
        f"{forces[0]:.12g} = p/2; with 2p/(pi a²), which is Hertz's, {forces[1]:.12g}",
        weigh(abs(forces[0] - 3.0) <= 1e-9),
        {"printed": forces[0], "hertz": forces[1]},
    )


def _zeros() -> tuple[Finding, Finding]:
    # 1.5/pi y/(1 + y²) is an antiderivative of eq (19), so it integrates to zero.
    edge = 1e4
    fine = np.linspace(-40.0, 40.0, 400_001)
    numeric = float(np.trapezoid(_ours(fine, 0.5), fine))
    tail = 2 * 1.5 / np.pi * (edge / (1 + edge**2))
    known = 2 * 1.5 / np.pi * (40.0 / (1 + 40.0**2))
    circuit = synthesise(
        paper_scene("paper-breadboard"), make_problem(paper_scene("paper-breadboard"))
    )
    absent = int(np.sum(~np.isfinite(circuit.matrices[0].ohms)))
    return (
        Finding(
            "kernel-mean",
            "integral of eq (19) over -y to y, trapezoidal and closed form",
            f"{numeric:.6f} ({known:.6f}) at y = 40, {tail:.0e} at 1e4: it tends to zero, so the"
            " strain does not tell the mean of the stress; the regulariser sets it. Condition: a"
            " finite range",
            weigh(tail > 1e-2, abs(numeric - known) < 1e-6),
            {"at_40": numeric, "closed_form": known},
        ),
        Finding(
            "resistors",
            "resistors 1/T of the seven-channel board",
            f"{absent} of 49 entries are zero (neighbours at a distance of exactly x): no resistor"
            " there. Condition: T is not zero",
            weigh(absent == 0, absent == 12),
            {"absent": float(absent)},
        ),
    )
