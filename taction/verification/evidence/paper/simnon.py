"""Section 4.2: why simulation was hard for SIMNON, an explicit against an implicit method."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from taction.system.array_types import Floats
from taction.system.charts import SERIES, Axis, Curve
from taction.verification.evidence.paper.findings import Chapter, Finding, finding, weigh
from taction.verification.evidence.paper.pictures import Picture, level, panel, picture
from taction.verification.evidence.paper.tactile import Geometry, largest_difference, unit_network
from taction.verification.reference.dynamics import (
    TOLERANCE,
    Response,
    ScaledNetwork,
    ideal_transient,
)

GEOMETRY = Geometry(21, 6.0)
MU = 5e-4
REAL_AXIS = 2.785  # classical Runge-Kutta is stable for steps up to this over the fastest rate
QUARTER = 0.25
RUNAWAY = 10.0  # above every output of this network
MAX_ERROR = 1e-3  # of the largest output
END = 5.0  # R C
AGREEMENT = 1e-6  # largest difference of two methods over the largest output
INSTANTS = 50
SHARES: tuple[float, ...] = (0.7, 0.5, 0.35, 0.25)  # of the largest step that is stable at rest
TOLERANCES: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
QUICK = 2  # of `SHARES` in a quick run: the least that shows how the error falls


@dataclass(frozen=True, slots=True)
class _Run:
    """One integration: error over the largest output, wall time in s, evaluations of the slope."""

    error: float
    seconds: float
    evaluations: int


def simnon(quick: bool) -> Chapter:
    """Judge section 4.2's remarks on simulation with the exponential network."""
    network = unit_network(GEOMETRY.matrix, GEOMETRY.strain(1, 0.01), MU)
    exact = ideal_transient(network, np.zeros(GEOMETRY.channels))
    scaled = ScaledNetwork(network)
    instants = np.linspace(0.0, END, INSTANTS + 1)[1:]
    found = network.rest
    rest = found.u if found.v is None else found.v
    fastest = float(np.max(-np.linalg.eigvals(scaled.jacobian(0.0, rest)).real))
    truth = np.full((INSTANTS, GEOMETRY.channels), np.nan)
    if exact is not None:
        truth = exact.outputs(instants * network.RC)
    steps = [share * REAL_AXIS / fastest for share in SHARES[: QUICK if quick else None]]
    explicit = [_measure(partial(_runge_kutta, scaled, instants, h), truth) for h in steps]
    implicit = [_measure(partial(_by_scipy, scaled, instants, t), truth) for t in TOLERANCES]
    findings = (
        _unstable(scaled, fastest),
        _cost(explicit, implicit, scaled.stiffness(rest)),
        _accuracy(
            exact, largest_difference(_by_scipy(scaled, instants, TOLERANCE, "LSODA")[0], truth)
        ),
    )
    return Chapter(findings, (_picture(explicit, implicit),))


def _runge_kutta(scaled: ScaledNetwork, instants: Floats, step: float) -> tuple[Floats, int]:
    """Return outputs (P, N) at equally spaced `instants` by the classical method of order 4."""
    x, outputs = np.zeros(GEOMETRY.channels), []
    steps = max(int(np.ceil(float(instants[0]) / step)), 1)  # between two instants
    h, slope = float(instants[0]) / steps, scaled.slope
    with np.errstate(all="ignore"):
        for _ in instants:
            for _ in range(steps):
                a = slope(0.0, x)
                b = slope(0.0, x + 0.5 * h * a)
                c = slope(0.0, x + 0.5 * h * b)
                d = slope(0.0, x + h * c)
                x = x + h / 6.0 * (a + 2.0 * (b + c) + d)
            outputs.append(np.exp(x))
    return np.array(outputs), 4 * steps * len(instants)


def _by_scipy(
    scaled: ScaledNetwork,
    instants: Floats,
    tolerance: float,
    method: Literal["Radau", "LSODA"] = "Radau",
) -> tuple[Floats, int]:
    from scipy.integrate import solve_ivp

    run = solve_ivp(
        scaled.slope, (0.0, END), np.zeros(GEOMETRY.channels), method, t_eval=instants,
        jac=scaled.jacobian, rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    return np.exp(run.y.T), int(run.nfev)


def _measure(run: Callable[[], tuple[Floats, int]], truth: Floats) -> _Run:
    seconds = np.inf
    for _ in range(2):
        start = time.perf_counter()
        u, evaluations = run()
        seconds = min(seconds, time.perf_counter() - start)
    error = largest_difference(u, truth)
    return _Run(error if np.isfinite(error) else np.inf, seconds, evaluations)


def _unstable(scaled: ScaledNetwork, fastest: float) -> Finding:
    """Keep the step, a quarter of the largest stable one at first, and shrink C by bisection."""
    instants = np.linspace(0.0, 0.2, 3)[1:]
    step = QUARTER * REAL_AXIS / fastest
    stable, unstable = 1.0, 0.05  # C over its first value
    while stable > 1.02 * unstable:
        middle = float(np.sqrt(stable * unstable))
        u, _ = _runge_kutta(scaled, instants, step / middle)
        bounded = np.all(np.isfinite(u)) and float(np.max(np.abs(u))) < RUNAWAY
        stable, unstable = (middle, unstable) if bounded else (stable, middle)
    return finding(
        "simnon-unstable",
        {"capacitance_ratio": unstable, "fastest_rate_rc": fastest},
        weigh(0.6 * QUARTER < unstable < 1.7 * QUARTER),
        step=step,
        channels=GEOMETRY.channels,
        limit=REAL_AXIS,
        quarter=QUARTER,
    )


def _cost(explicit: list[_Run], implicit: list[_Run], stiffness: float) -> Finding:
    runge_kutta, radau = (
        min((run for run in runs if run.error <= MAX_ERROR), key=lambda run: run.evaluations)
        for runs in (explicit, implicit)
    )
    ratio = runge_kutta.evaluations / radau.evaluations
    return finding(
        "simnon-cost",
        {"explicit": runge_kutta.seconds, "implicit": radau.seconds, "evaluations_ratio": ratio},
        weigh(False, ratio > 10.0),
        end=END,
        error=MAX_ERROR,
        evaluations=(runge_kutta.evaluations, radau.evaluations),
        stiffness=stiffness,
    )


def _accuracy(run: Response | None, second_opinion: float) -> Finding:
    """Judge the transient by the largest difference to that of another method."""
    settling = run.settling_time() if run is not None else float("nan")
    values = {"settling_time_rc": settling, "second_opinion": second_opinion}
    return finding("simnon-accuracy", values, weigh(not second_opinion <= AGREEMENT))


def _picture(explicit: list[_Run], implicit: list[_Run]) -> Picture:
    y, charts = Axis("largest error / largest output", scale="log"), []
    for title, x, key in (
        ("error against run time", Axis("wall time", "s", "log"), "seconds"),
        (
            "error against work",
            Axis("evaluations of the right-hand side", scale="log"),
            "evaluations",
        ),
    ):
        curves = (
            Curve(
                [getattr(run, key) for run in runs], [run.error for run in runs], name, look,
                mark=mark,
            )
            for runs, name, look, mark in (
                (explicit, "Runge-Kutta, explicit", SERIES[3], "square"),
                (implicit, "Radau IIA, implicit", SERIES[0], "circle"),
            )
        )  # fmt: skip
        charts.append(panel(title, x, y, *curves, level(MAX_ERROR, "enough")))
    text = "The explicit method is stable only where it is far more accurate than necessary."
    return picture(text, *charts)
