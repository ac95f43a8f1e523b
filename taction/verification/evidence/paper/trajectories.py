"""Trajectories of the network: what was hard for SIMNON, the energy's descent, and theorem 3.1."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import numpy as np

from taction.system.array_types import Floats
from taction.verification.evidence.paper.findings import Chapter, Finding, finding, weigh
from taction.verification.evidence.paper.tactile import Geometry, difference, unit_network
from taction.verification.reference.ideal_answer import (
    TOLERANCE,
    IdealNetwork,
    ScaledNetwork,
    ideal_transient,
)
from taction.verification.reference.regularisers import REGULARISERS

STIFF, SMALL = Geometry(21, 6.0), Geometry(15, 6.0)  # of the chapters simnon and energy
STIFF_MU, SMALL_MU = 5e-4, 0.05
REAL_AXIS = 2.785  # classical Runge-Kutta is stable for steps up to this over the fastest rate
QUARTER = 0.25
RUNAWAY = 10.0  # above every output of this network
MAX_ERROR = 1e-3  # of the largest output
END = 5.0  # R C
AGREEMENT = 1e-6  # largest difference of two methods over the largest output
INSTANTS = np.linspace(0.0, END, 51)[1:]
SHARE = 0.7  # of the largest step that is stable at rest, with which the start is stable, too
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
STARTS = 4
LEAST_SLOPE = 1e-9  # of an amplifier in the curvature: where its slope is 0 the energy is steeper
STATES = 200  # random states for each regulariser

Solved = tuple[Floats, int]  # outputs (P, N), evaluations of the slope


def simnon(quick: bool) -> Chapter:
    """Judge section 4.2's remarks on simulation with the exponential network."""
    network = unit_network(STIFF.matrix, STIFF.strain(1, 0.01), STIFF_MU)
    scaled, rest = ScaledNetwork(network), _rest(network)
    fastest = float(np.max(-np.linalg.eigvals(scaled.jacobian(0.0, rest)).real))
    exact = ideal_transient(network, np.zeros(STIFF.channels))
    settling, truth = np.nan, np.full((len(INSTANTS), STIFF.channels), np.nan)
    if exact is not None:
        settling, truth = exact.settling_time(), exact.outputs(INSTANTS)
    explicit = partial(_runge_kutta, scaled, INSTANTS, SHARE * REAL_AXIS / fastest)
    implicit = [partial(_by_scipy, scaled, "Radau", tolerance) for tolerance in TOLERANCES]
    second = difference(_by_scipy(scaled, "LSODA", TOLERANCE)[0], truth)
    accuracy = finding(
        "simnon-accuracy",
        weigh(not second <= AGREEMENT),
        settling_time_rc=settling,
        second_opinion=second,
    )
    costs = [_cheapest(truth, [explicit]), _cheapest(truth, implicit)]
    ratio = costs[0][0] / costs[1][0]
    cost = finding(
        "simnon-cost",
        weigh(False, ratio > 10.0),
        explicit=costs[0][1],
        implicit=costs[1][1],
        evaluations_ratio=ratio,
        end=END,
        error=MAX_ERROR,
        evaluations=[evaluations for evaluations, _ in costs],
        stiffness=scaled.stiffness(rest),
    )
    return Chapter((_unstable(scaled, fastest), cost, accuracy))


def _rest(network: IdealNetwork) -> Floats:
    rest = network.rest
    return rest.u if rest.v is None else rest.v


def _runge_kutta(scaled: ScaledNetwork, instants: Floats, step: float) -> Solved:
    """Solve up to equally spaced `instants` by the classical method of order 4 and fixed steps."""
    x, outputs, slope = np.zeros(STIFF.channels), [], scaled.slope
    steps = max(int(np.ceil(float(instants[0]) / step)), 1)  # between two instants
    h = float(instants[0]) / steps
    with np.errstate(all="ignore"):
        for _ in instants:
            for _ in range(steps):
                a = slope(0.0, x)
                b = slope(0.0, x + 0.5 * h * a)
                c = slope(0.0, x + 0.5 * h * b)
                x = x + h / 6.0 * (a + 2.0 * (b + c) + slope(0.0, x + h * c))
            outputs.append(np.exp(x))
    return np.array(outputs), 4 * steps * len(instants)


def _by_scipy(scaled: ScaledNetwork, method: Literal["Radau", "LSODA"], tolerance: float) -> Solved:
    from scipy.integrate import solve_ivp

    run = solve_ivp(
        scaled.slope, (0.0, END), np.zeros(STIFF.channels), method, t_eval=INSTANTS,
        jac=scaled.jacobian, rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    return np.exp(run.y.T), int(run.nfev)


def _cheapest(truth: Floats, runs: Sequence[Callable[[], Solved]]) -> tuple[int, float]:
    """Return the fewest evaluations of an accurate run, and its wall time, s."""
    accurate = []
    for run in runs:
        start = time.perf_counter()
        u, evaluations = run()
        if difference(u, truth) <= MAX_ERROR:
            accurate.append((evaluations, time.perf_counter() - start))
    return min(accurate, default=(0, np.nan))


def _unstable(scaled: ScaledNetwork, fastest: float) -> Finding:
    """Keep the step, a quarter of the largest stable one at first, and shrink C by bisection."""
    instants, step = np.linspace(0.0, 0.2, 3)[1:], QUARTER * REAL_AXIS / fastest
    stable, unstable = 1.0, 0.05  # C over its first value
    while stable > 1.02 * unstable:
        middle = float(np.sqrt(stable * unstable))
        u, _ = _runge_kutta(scaled, instants, step / middle)
        bounded = float(np.max(np.abs(u))) < RUNAWAY  # false of NaN, too
        stable, unstable = (middle, unstable) if bounded else (stable, middle)
    return finding(
        "simnon-unstable",
        weigh(0.6 * QUARTER < unstable < 1.7 * QUARTER),
        capacitance_ratio=unstable,
        fastest_rate_rc=fastest,
        step=step,
        channels=STIFF.channels,
        limit=REAL_AXIS,
        quarter=QUARTER,
    )


def energy(quick: bool) -> Chapter:
    """Judge the Lyapunov property on the exponential network and the convexity of eq (17)."""
    network = unit_network(SMALL.matrix, SMALL.strain(1, 0.01), SMALL_MU)
    scaled = ScaledNetwork(network)
    x = np.random.default_rng(4).normal(0.0, 1.0, SMALL.channels)
    by_v = scaled.jacobian(0.0, x)
    in_v, in_u = (
        float(np.linalg.norm(J - J.T) / np.linalg.norm(J)) for J in (by_v, by_v / np.exp(x))
    )
    rng, starts = np.random.default_rng(3), 2 if quick else STARTS
    ends = [_final(network, rng.normal(0.0, 2.0, SMALL.channels)) for _ in range(starts)]
    off = float(np.max([difference(u, network.rest.u) for u in ends]))
    attraction = finding("asymptotically-stable", weigh(off <= 1e-6), difference=off, starts=starts)
    symmetry = finding("hypothesis-2", weigh(in_v <= 1e-12), in_v=in_v, in_u=in_u)
    findings = (_descent(network, scaled), _gradient(scaled), attraction, symmetry, _minima(quick))
    return Chapter(findings)


def _descent(network: IdealNetwork, scaled: ScaledNetwork) -> Finding:
    """Compare the energy that is lost with the integral of the power ``sum C g' v'^2``."""
    from scipy.integrate import solve_ivp

    def slopes(_: float, state: Floats) -> Floats:
        slope = scaled.slope(0.0, state[:-1])
        return np.append(slope, np.sum(scaled.g.slope(state[:-1]) * slope**2))

    x0, rising, residual = np.zeros(SMALL.channels), np.inf, np.inf
    if (run := ideal_transient(network, x0)) is not None:
        levels = np.array([scaled.energy(row) for row in np.log(run.outputs(run.time))])
        lost = float(levels[0] - levels[-1])
        rising = float(np.max(np.diff(levels), initial=0.0)) / lost
        span, start = (0.0, float(run.time[-1])), np.append(x0, 0.0)
        second = solve_ivp(slopes, span, start, "Radau", rtol=TOLERANCE, atol=TOLERANCE)
        residual = abs(float(second.y[-1, -1]) / lost - 1.0) if second.success else np.nan
    return finding(
        "lyapunov",
        weigh(residual <= AGREEMENT and rising <= 1e-9),
        residual=residual,
        largest_rise=rising,
        channels=SMALL.channels,
        stiffness=scaled.stiffness(_rest(network)),
    )


def _gradient(scaled: ScaledNetwork) -> Finding:
    """Compare ``du/dt`` with ``-G C⁻¹ dP/du``, the gradient by central differences in u."""
    x = np.random.default_rng(2).normal(0.0, 1.0, SMALL.channels)
    u, steps = np.exp(x), 1e-5 * np.diag(np.exp(x))
    rises = [scaled.energy(np.log(u + step)) - scaled.energy(np.log(u - step)) for step in steps]
    off = difference(-np.array(rises) / 2e-5, u * scaled.slope(0.0, x))
    return finding("gradient-system", weigh(off <= 1e-6), difference=off)


def _final(network: IdealNetwork, start: Floats) -> Floats:
    """Return the outputs (N,) at the end of a transient; NaN for a transient that failed."""
    run = ideal_transient(network, start)
    return np.full(SMALL.channels, np.nan) if run is None else run.outputs(run.time[-1:])[0]


def _minima(quick: bool) -> Finding:
    """Search for a direction in which an energy of the class (17) curves down."""
    rng, T = np.random.default_rng(5), SMALL.matrix
    least, apart = np.inf, 0.0
    kinds = [name for name in REGULARISERS if name != "linear"][:: 2 if quick else 1]
    for name in kinds:
        network = unit_network(T, SMALL.strain(1, 0.01), SMALL_MU, name)
        for _ in range(STATES):
            v = rng.normal(0.0, 2.0, SMALL.channels)
            slope = np.maximum(REGULARISERS[name].slope(v), LEAST_SLOPE)
            hessian = T.T @ T / SMALL_MU + np.diag(1.0 / slope)
            least = min(least, float(np.linalg.eigvalsh(hessian)[0]))
        first, second = (_final(network, rng.normal(0.0, 1.5, SMALL.channels)) for _ in range(2))
        apart = float(np.maximum(apart, np.max(np.abs(first - second))))
    return finding(
        "multiple-minima",
        weigh(not (least > 0.0 and apart <= 1e-5)),
        least_eigenvalue=least,
        apart=apart,
        drawn=STATES,
        kinds=", ".join(kinds),
    )
