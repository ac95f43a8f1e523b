"""Section 3 and 4.1: the energy function, its descent, and what theorem 3.1 needs."""

from __future__ import annotations

import numpy as np

from spice_models.array_types import Floats
from verification.reference import IdealNetwork, ideal_transient
from verification.reference.dynamics import AGREEMENT, ScaledNetwork, Trust
from verification.reference.regularisers import REGULARISERS
from verification.studies.paper.findings import Chapter, Finding, Panel, Picture, curve, weigh
from verification.studies.paper.tactile import Geometry
from verification.studies.paper.unit_network import unit_network

GEOMETRY = Geometry("", 15, 6.0)
MU = 0.05
STARTS = 4
DRAWN = 200


def energy(quick: bool) -> Chapter:
    """Judge the Lyapunov property on the exponential network and the convexity of eq (17)."""
    strain = GEOMETRY.strain(1, 0.01)
    network = unit_network(GEOMETRY.matrix, strain, MU)
    descent, picture = _descent(network)
    findings = (
        descent,
        _gradient(network),
        _everywhere(network, 2 if quick else STARTS),
        _symmetry(network),
        _minima(),
    )
    return Chapter(findings, (picture,))


def _descent(network: IdealNetwork) -> tuple[Finding, Picture]:
    run = ideal_transient(network, np.zeros(GEOMETRY.channels))
    scaled = ScaledNetwork(network)
    residual = run.energy_residual
    time, fallen = np.array([0.0]), np.array([0.0])
    rising = np.inf
    if run.response is not None:
        time = run.response.time
        u = run.response.outputs(time)
        levels = np.array([scaled.energy(row) for row in np.log(u)])
        fallen = levels - levels[-1]
        rising = float(np.max(np.diff(levels), initial=0.0)) / float(levels[0] - levels[-1])
    finding = Finding(
        "lyapunov",
        f"exponential network, N = {GEOMETRY.channels}, stiffness {run.stiffness:.2g}, Radau"
        " at 1e-10 with LSODA as second opinion",
        f"P(t) - P(0) + ∫ Σ C g' v'² dt = 0 to {residual:.1e} of the energy lost; P never rises"
        f" by more than {rising:.0e}",
        weigh(run.outcome is Trust.TRUSTED and residual <= AGREEMENT and rising <= 1e-9),
        {"residual": residual, "largest_rise": rising},
    )
    shown = (time > 1e-5) & (fallen > 1e-12 * fallen.max())
    panel = Panel("energy above its minimum", "time (RC)", "P - P(end)",
                  (curve(time[shown], fallen[shown]),), logs="xy")  # fmt: skip
    return finding, Picture("energy", "The energy falls along a trajectory.", (panel,))


def _gradient(network: IdealNetwork) -> Finding:
    """Compare ``du/dt`` with ``-G C⁻¹ dP/du``, the gradient by central differences in u."""
    scaled = ScaledNetwork(network)
    x = np.random.default_rng(2).normal(0.0, 1.0, GEOMETRY.channels)
    u, step = np.exp(x), 1e-5
    slope = np.empty_like(u)
    for n in range(len(u)):
        above, below = u.copy(), u.copy()
        above[n] *= 1.0 + step
        below[n] *= 1.0 - step
        rise = scaled.energy(np.log(above)) - scaled.energy(np.log(below))
        slope[n] = rise / (2.0 * step * u[n])
    flow = u * scaled.slope(0.0, x)
    off = float(np.max(np.abs(flow + u * slope)) / np.max(np.abs(flow)))
    return Finding(
        "gradient-system",
        "eq (11) at a random state: du/dt against -G C⁻¹ ∂P/∂u by differences, P of eq (16)",
        f"equal to {off:.0e}",
        weigh(off <= 1e-6),
        {"difference": off},
    )


def _everywhere(network: IdealNetwork, starts: int) -> Finding:
    rng, apart = np.random.default_rng(3), []
    for _ in range(starts):
        run = ideal_transient(network, rng.normal(0.0, 2.0, GEOMETRY.channels))
        if run.response is not None:
            end = run.response.outputs(run.response.time[-1:])[0]
            apart.append(float(np.max(np.abs(end - run.rest.u)) / np.max(np.abs(run.rest.u))))
    worst = max(apart, default=np.inf)
    return Finding(
        "asymptotically-stable",
        f"the same network from {starts} random states",
        f"each ends at the minimum of eq (16), to {worst:.0e} of the largest output",
        weigh(len(apart) == starts and worst <= 1e-6),
        {"difference": worst},
    )


def _symmetry(network: IdealNetwork) -> Finding:
    scaled = ScaledNetwork(network)
    x = np.random.default_rng(4).normal(0.0, 1.0, GEOMETRY.channels)
    in_v = scaled.jacobian(0.0, x)
    in_u = in_v / np.exp(x)
    asymmetry = [_asymmetry(jacobian) for jacobian in (in_v, in_u)]
    return Finding(
        "hypothesis-2",
        "Jacobian of the capacitor currents at a random state, by v and by u",
        f"‖J - Jᵀ‖ / ‖J‖ is {asymmetry[0]:.2g} in v and {asymmetry[1]:.0e} in u; so theorem 3.1"
        " does not apply to exponential amplifiers, the descent dP/dt = -Σ C g' v'² ≤ 0 does",
        weigh(asymmetry[0] <= 1e-12),
        {"in_v": asymmetry[0], "in_u": asymmetry[1]},
    )


def _asymmetry(jacobian: Floats) -> float:
    return float(np.linalg.norm(jacobian - jacobian.T) / np.linalg.norm(jacobian))


def _minima() -> Finding:
    """Look for a direction in which an energy of the class (17) curves down."""
    rng = np.random.default_rng(5)
    T = GEOMETRY.matrix
    least, apart = np.inf, 0.0
    kinds = [name for name in REGULARISERS if name != "linear"]
    for name in kinds:
        network = unit_network(T, GEOMETRY.strain(1, 0.01), MU, name)
        entry = REGULARISERS[name]
        for _ in range(DRAWN):
            v = rng.normal(0.0, 2.0, GEOMETRY.channels)
            hessian = T.T @ T / MU + np.diag(1.0 / entry.slope(v))
            least = min(least, float(np.linalg.eigvalsh(hessian)[0]))
        ends = []
        for _ in range(2):
            run = ideal_transient(network, rng.normal(0.0, 1.5, GEOMETRY.channels))
            if run.response is not None:
                ends.append(run.response.outputs(run.response.time[-1:])[0])
        apart = max(apart, float(np.max(np.abs(ends[0] - ends[-1]))) if len(ends) == 2 else np.inf)
    return Finding(
        "multiple-minima",
        f"Hessian in u at {DRAWN} random states, and two random starts, for {', '.join(kinds)}",
        f"least eigenvalue {least:.2g} > 0; ends at most {apart:.0e} apart: an increasing g makes"
        " ∫ g⁻¹ convex, the minimum is unique",
        weigh(not (least > 0.0 and apart <= 1e-5)),
        {"least_eigenvalue": least, "apart": apart},
    )
