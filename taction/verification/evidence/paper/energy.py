"""Section 3 and 4.1: the energy function, its descent, and the conditions of theorem 3.1."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats
from taction.system.charts import Axis, Curve
from taction.verification.evidence.paper.findings import Chapter, Finding, finding, weigh
from taction.verification.evidence.paper.pictures import Picture, panel, picture
from taction.verification.evidence.paper.tactile import Geometry, largest_difference, unit_network
from taction.verification.reference.dynamics import (
    TOLERANCE,
    IdealNetwork,
    Response,
    ScaledNetwork,
    ideal_transient,
)
from taction.verification.reference.regularisers import REGULARISERS

GEOMETRY = Geometry(15, 6.0)
MU = 0.05
STARTS = 4
AGREEMENT = 1e-6  # largest difference of the energy lost and the energy dissipated
LEAST_SLOPE = 1e-9  # of an amplifier in the curvature: where its slope is 0 the energy is steeper
STATES = 200  # random states for each regulariser


def energy(quick: bool) -> Chapter:
    """Judge the Lyapunov property on the exponential network and the convexity of eq (17)."""
    network = unit_network(GEOMETRY.matrix, GEOMETRY.strain(1, 0.01), MU)
    descent, picture = _descent(network)
    scaled = ScaledNetwork(network)
    attraction = _everywhere(network, 2 if quick else STARTS)
    findings = (descent, _gradient(scaled), attraction, _symmetry(scaled), _minima(quick))
    return Chapter(findings, (picture,))


def _descent(network: IdealNetwork) -> tuple[Finding, Picture]:
    scaled, x0 = ScaledNetwork(network), np.zeros(GEOMETRY.channels)
    run = ideal_transient(network, x0)
    time, fallen = np.array([0.0]), np.array([0.0])
    rising = residual = np.inf
    if run is not None:
        time = run.time
        levels = np.array([scaled.energy(row) for row in np.log(run.outputs(time))])
        fallen = levels - levels[-1]
        rising = float(np.max(np.diff(levels), initial=0.0)) / float(levels[0] - levels[-1])
        residual = abs(_dissipated(scaled, x0, float(time[-1] / network.RC)) / fallen[0] - 1.0)
    rest = network.rest
    result = finding(
        "lyapunov",
        {"residual": residual, "largest_rise": rising},
        weigh(residual <= AGREEMENT and rising <= 1e-9),
        channels=GEOMETRY.channels,
        stiffness=scaled.stiffness(rest.u if rest.v is None else rest.v),
    )
    shown = (time > 1e-5) & (fallen > 1e-12 * fallen.max())
    axes = Axis("time (RC)", scale="log"), Axis("P - P(end)", scale="log")
    chart = panel("energy above its minimum", *axes, Curve(time[shown], fallen[shown]))
    return result, picture("The energy falls along a trajectory.", chart)


def _dissipated(scaled: ScaledNetwork, x0: Floats, end: float) -> float:
    """Return the integral of ``sum C g' v'^2`` to an instant over R C: the energy that is lost.

    The power is one more unknown of the integrator, beside the x of the network.
    """
    from scipy.integrate import solve_ivp

    def slopes(_: float, state: Floats) -> Floats:
        slope = scaled.slope(0.0, state[:-1])
        return np.append(slope, np.sum(scaled.g.slope(state[:-1]) * slope**2))

    run = solve_ivp(slopes, (0.0, end), np.append(x0, 0.0), "Radau", rtol=TOLERANCE, atol=TOLERANCE)
    return float(run.y[-1, -1]) if run.success else np.nan


def _gradient(scaled: ScaledNetwork) -> Finding:
    """Compare ``du/dt`` with ``-G C⁻¹ dP/du``, the gradient by central differences in u."""
    x = np.random.default_rng(2).normal(0.0, 1.0, GEOMETRY.channels)
    u, step = np.exp(x), 1e-5
    slope = np.empty_like(u)
    for n in range(len(u)):
        above, below = u.copy(), u.copy()
        above[n] *= 1.0 + step
        below[n] *= 1.0 - step
        rise = scaled.energy(np.log(above)) - scaled.energy(np.log(below))
        slope[n] = rise / (2.0 * step * u[n])
    difference = largest_difference(-u * slope, u * scaled.slope(0.0, x))
    return finding("gradient-system", {"difference": difference}, weigh(difference <= 1e-6))


def _final(run: Response | None) -> Floats:
    """Return the outputs (N,) at the end of a transient; NaN for a transient that failed."""
    return np.full(GEOMETRY.channels, np.nan) if run is None else run.outputs(run.time[-1:])[0]


def _everywhere(network: IdealNetwork, starts: int) -> Finding:
    rng = np.random.default_rng(3)
    runs = [
        ideal_transient(network, rng.normal(0.0, 2.0, GEOMETRY.channels)) for _ in range(starts)
    ]
    worst = float(np.max([largest_difference(_final(run), network.rest.u) for run in runs]))
    outcome = weigh(worst <= 1e-6)
    return finding("asymptotically-stable", {"difference": worst}, outcome, starts=starts)


def _symmetry(scaled: ScaledNetwork) -> Finding:
    x = np.random.default_rng(4).normal(0.0, 1.0, GEOMETRY.channels)
    by_v = scaled.jacobian(0.0, x)
    values = {
        name: float(np.linalg.norm(jacobian - jacobian.T) / np.linalg.norm(jacobian))
        for name, jacobian in (("in_v", by_v), ("in_u", by_v / np.exp(x)))
    }
    return finding("hypothesis-2", values, weigh(values["in_v"] <= 1e-12))


def _minima(quick: bool) -> Finding:
    """Search for a direction in which an energy of the class (17) curves down.

    `quick` leaves out every second amplifier: smooth ones and ones of straight pieces remain.
    """
    rng = np.random.default_rng(5)
    T = GEOMETRY.matrix
    least, apart = np.inf, 0.0
    kinds = [name for name in REGULARISERS if name != "linear"][:: 2 if quick else 1]
    for name in kinds:
        network = unit_network(T, GEOMETRY.strain(1, 0.01), MU, name)
        for _ in range(STATES):
            v = rng.normal(0.0, 2.0, GEOMETRY.channels)
            slope = np.maximum(REGULARISERS[name].slope(v), LEAST_SLOPE)
            hessian = T.T @ T / MU + np.diag(1.0 / slope)
            least = min(least, float(np.linalg.eigvalsh(hessian)[0]))
        starts = (rng.normal(0.0, 1.5, GEOMETRY.channels) for _ in range(2))
        first, second = (_final(ideal_transient(network, start)) for start in starts)
        apart = float(np.maximum(apart, np.max(np.abs(first - second))))
    values = {"least_eigenvalue": least, "apart": apart}
    outcome = weigh(not (least > 0.0 and apart <= 1e-5))
    return finding("multiple-minima", values, outcome, drawn=STATES, kinds=", ".join(kinds))
