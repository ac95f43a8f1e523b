"""Section 4.2: what made simulation hard for SIMNON, an explicit method against an implicit one."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from netlist_gen.quantities import show
from spice_models.array_types import Floats
from verification.reference import ideal_transient
from verification.reference.dynamics import AGREEMENT, ScaledNetwork, Transient, Trust
from verification.studies.paper.findings import Chapter, Finding, Panel, Picture, curve, weigh
from verification.studies.paper.tactile import Geometry
from verification.studies.paper.unit_network import unit_network

GEOMETRY = Geometry("", 21, 6.0)
MU = 5e-4
REAL_AXIS = 2.785  # classical Runge-Kutta is stable for steps up to this over the fastest rate
QUARTER = 0.25
RUNAWAY = 10.0  # no output of this network is as large
WANTED = 1e-3  # error, of the largest output
END = 5.0  # R C
INSTANTS = 50
SHARES: tuple[float, ...] = (0.7, 0.5, 0.35, 0.25)  # of the largest step that is stable at rest
TOLERANCES: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
QUICK = slice(1, 2)  # of both in a quick run


@dataclass(frozen=True, slots=True)
class _Run:
    """One integration: error over the largest output, wall time, evaluations of the slope."""

    error: float
    seconds: float
    evaluations: int


def simnon(quick: bool) -> Chapter:
    """Judge section 4.2's remarks on simulation with the exponential network."""
    network = unit_network(GEOMETRY.matrix, GEOMETRY.strain(1, 0.01), MU)
    exact = ideal_transient(network, np.zeros(GEOMETRY.channels))
    scaled = ScaledNetwork(network)
    instants = np.linspace(0.0, END, INSTANTS + 1)[1:]
    rest = exact.rest.u if exact.rest.v is None else exact.rest.v
    fastest = float(np.max(-np.linalg.eigvals(scaled.jacobian(0.0, rest)).real))
    if exact.response is None:
        truth = np.full((INSTANTS, GEOMETRY.channels), np.nan)
    else:
        truth = exact.response.outputs(instants)
    shares = SHARES[QUICK] if quick else SHARES
    tolerances = TOLERANCES[QUICK] if quick else TOLERANCES
    explicit = [
        _judge(partial(_runge_kutta, scaled, instants, share * REAL_AXIS / fastest), truth)
        for share in shares
    ]
    implicit = [_judge(partial(_radau, scaled, instants, each), truth) for each in tolerances]
    findings = (
        _unstable(scaled, fastest),
        _cost(explicit, implicit, exact.stiffness),
        _assessed(exact),
    )
    return Chapter(findings, (_picture(explicit, implicit),))


def _runge_kutta(scaled: ScaledNetwork, instants: Floats, step: float) -> tuple[Floats, int]:
    """Return outputs (P, N) at equally spaced `instants` by the classical method of order 4."""
    x, found = np.zeros(GEOMETRY.channels), []
    per = max(int(np.ceil(float(instants[0]) / step)), 1)
    h, slope = float(instants[0]) / per, scaled.slope
    with np.errstate(all="ignore"):
        for _ in instants:
            for _ in range(per):
                a = slope(0.0, x)
                b = slope(0.0, x + 0.5 * h * a)
                c = slope(0.0, x + 0.5 * h * b)
                d = slope(0.0, x + h * c)
                x = x + h / 6.0 * (a + 2.0 * (b + c) + d)
            found.append(np.exp(x))
    return np.array(found), 4 * per * len(instants)


def _radau(scaled: ScaledNetwork, instants: Floats, tolerance: float) -> tuple[Floats, int]:
    from scipy.integrate import solve_ivp

    run = solve_ivp(
        scaled.slope, (0.0, END), np.zeros(GEOMETRY.channels), "Radau", t_eval=instants,
        jac=scaled.jacobian, rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    return np.exp(run.y.T), int(run.nfev)


def _judge(run: Callable[[], tuple[Floats, int]], truth: Floats) -> _Run:
    seconds = np.inf
    for _ in range(2):
        start = time.perf_counter()
        u, evaluations = run()
        seconds = min(seconds, time.perf_counter() - start)
    error = float(np.max(np.abs(u - truth)) / np.max(np.abs(truth)))
    return _Run(error if np.isfinite(error) else np.inf, seconds, evaluations)


def _unstable(scaled: ScaledNetwork, fastest: float) -> Finding:
    """Keep the step, a quarter of the largest stable one at first, and shrink C by bisection."""
    instants = np.linspace(0.0, 0.2, 3)[1:]
    sound, broken = 1.0, 0.05  # C over what it was at first
    while sound > 1.02 * broken:
        middle = float(np.sqrt(sound * broken))
        u, _ = _runge_kutta(scaled, instants, QUARTER * REAL_AXIS / (fastest * middle))
        near = np.all(np.isfinite(u)) and float(np.max(np.abs(u))) < RUNAWAY
        sound, broken = (middle, broken) if near else (sound, middle)
    return Finding(
        "simnon-unstable",
        f"classical Runge-Kutta with a fixed step of {QUARTER * REAL_AXIS / fastest:.1g} RC,"
        f" exponential network, N = {GEOMETRY.channels}; C is reduced, the step stays",
        f"the answer runs away once C is below {broken:.2g} of its first value (at rest the"
        f" method's limit, {REAL_AXIS} over the fastest rate, is {QUARTER:g})",
        weigh(0.6 * QUARTER < broken < 1.7 * QUARTER),
        {"capacitance_ratio": broken, "fastest_rate_rc": fastest},
    )


def _cost(explicit: list[_Run], implicit: list[_Run], stiffness: float) -> Finding:
    cheap, good = (
        min((run for run in runs if run.error <= WANTED), key=lambda run: run.evaluations)
        for runs in (explicit, implicit)
    )
    ratio = cheap.evaluations / good.evaluations
    return Finding(
        "simnon-cost",
        f"{END:g} RC of the same network to an error of {WANTED:g}: Runge-Kutta with the largest"
        " step that is stable against Radau IIA",
        f"{cheap.evaluations} evaluations and {show(cheap.seconds, 's', 3)} against"
        f" {good.evaluations} and {show(good.seconds, 's', 3)}. Condition: an explicit method; its"
        f" step is bound to the fastest rate ({stiffness:.2g} times the slowest, whatever C)",
        weigh(False, ratio > 10.0),
        {"explicit": cheap.seconds, "implicit": good.seconds, "evaluations_ratio": ratio},
    )


def _assessed(run: Transient) -> Finding:
    settling = run.response.settling_time() if run.response is not None else float("nan")
    return Finding(
        "simnon-accuracy",
        "1 % settling time by Radau at 1e-10, with LSODA as second opinion",
        f"{settling:.5g} RC; the two integrators differ by {run.second_opinion:.0e} of the step,"
        f" the energy identity is off by {run.energy_residual:.0e}",
        weigh(not (run.outcome is Trust.TRUSTED and run.second_opinion <= AGREEMENT)),
        {"settling_time_rc": settling, "second_opinion": run.second_opinion},
    )


def _picture(explicit: list[_Run], implicit: list[_Run]) -> Picture:
    panels = tuple(
        Panel(
            f"error against {title}",
            label,
            "largest error (of the largest output)",
            (
                curve([getattr(r, key) for r in explicit], [r.error for r in explicit],
                      "Runge-Kutta 4, explicit", "C3s-"),
                curve([getattr(r, key) for r in implicit], [r.error for r in implicit],
                      "Radau IIA, implicit", "C0o-"),
            ),
            logs="xy",
        )
        for title, label, key in (
            ("run time", "wall time (s)", "seconds"),
            ("work", "evaluations of the right-hand side", "evaluations"),
        )
    )  # fmt: skip
    text = "The explicit method starts where it becomes stable: far more accurate than asked for."
    return Picture("simnon", text, panels)
