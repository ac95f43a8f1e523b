"""How long to simulate a board and how finely, from its own time scales."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.scene.scene import Scene
from spice_models.errors import Complaint, EngineError, InputError
from verification.small_signal.time_scales import TimeScales

REMAINDER = 0.1  # of the steady-state tolerance: what may still ring when the record ends
MAX_POINTS = 2_000_000
AFTER_SETTLING = 1.2  # a settled record must also show that it stays so
POINTS_PER_PERIOD = 125.0  # where a scene asks neither for points nor for an error
RECORD_POINTS = 64.0  # a period, of a record that has no step: a cubic between them errs by 2e-6
FEWEST_POINTS = 50  # in a record
FEWEST_PER_PERIOD = 16.0  # points, however large an error is asked for
FEWEST_PERIODS = 8  # of ringing in a record, however fast it settles or grows


def plan_transient(
    scene: Scene, scales: TimeScales, engine: str = "ngspice", points: float | None = None
) -> Transient:
    """Choose stop time and maximum step of the transient of `scene`.

    The stop time follows the slowest mode that matters, down to a tenth of the steady-state
    tolerance (or the growth of an unstable one); the step follows the fastest ringing, or the
    error that the scene asks for (`step_for_error`), or puts `points` points on a period of that
    ringing. For the state-space engine the step only sets the spacing of the record, so an error
    does not change it.

    Raises
    ------
    EngineError
        The two are so far apart that the run would never end; the message says what to change.
    InputError
        ``analysis.stop`` is shorter than one step.
    """
    points = points or _points(scene, scales, engine)
    step = scales.max_step_for(points)
    if scene.analysis.stop == "auto":
        stop = max(_auto_stop(scene, scales), FEWEST_PERIODS * points * step)
    else:
        stop = scene.analysis.stop
        if stop < FEWEST_POINTS * step < math.inf:
            text = f"shorter than {FEWEST_POINTS} time steps of {step:.3g} s; longer, or 'auto'"
            raise InputError(scene.file, Complaint("analysis.stop", f"{stop!r} s", text))
    if not (math.isfinite(stop) and stop > 0):
        raise EngineError("no mode of this board shows at its outputs: there is nothing to time")
    step = min(step, stop / FEWEST_POINTS)
    if stop / step > MAX_POINTS:
        raise EngineError(
            f"the slowest mode needs {stop:.3g} s and the fastest ringing a step of {step:.3g} s:"
            f" {stop / step:.2g} points, over {MAX_POINTS:.0g}. The board is on the edge of"
            " oscillation, or its time scales are too far apart for one transient; give"
            " analysis.stop or fewer analysis.points_per_period (a larger analysis.error) to look"
            " at a part of it"
        )
    if scene.analysis.stop == "auto":
        stop = _six_digits(stop)
    return Transient(stop, _six_digits(step), truncation_for(points), scene.analysis.initial)


def step_for_error(scales: TimeScales, error: float, stop: float) -> float:
    """Return the step at which the trapezoidal rule errs by at most `error`, s: an estimate.

    A step of h moves a pole p by ``p³h²/12``, so a mode of amplitude a is wrong by
    ``a |p|³ h² t exp(Re p t) / 12`` after the time t, most at ``t = -1 / Re p``: the phase error
    piles up until the ringing has died. All modes add, as if in phase, but those with
    ``|p| h > 1``: the truncation error holds those. Never fewer than 16 points on a ringing period.

    Parameters
    ----------
    scales : TimeScales
        Of the board.
    error : float
        Fraction of the step amplitude.
    stop : float
        End of the record, s.
    """
    p, rate = np.abs(scales.poles), scales.poles.real
    worst = np.where(rate < 0.0, np.minimum(1.0 / np.maximum(-rate, 1e-300), stop), stop)
    with np.errstate(over="ignore"):
        share = scales.amplitudes * p**3 * worst * np.exp(rate * worst) / 12.0
    order = np.argsort(p)
    step, total = scales.max_step_for(FEWEST_PER_PERIOD), 0.0
    for speed, part in zip(p[order].tolist(), share[order].tolist(), strict=True):
        if speed * step > 1.0:
            break
        total += part
        step = min(step, math.sqrt(error / total)) if total > 0.0 else step
    return step


def coarser(transient: Transient, ratio: float) -> Transient:
    """Return the same transient with every step `ratio` times as long (trapezoidal rule)."""
    return replace(
        transient,
        max_step=ratio * transient.max_step,
        truncation=ratio**3 * transient.truncation,
    )


def _auto_stop(scene: Scene, scales: TimeScales) -> float:
    if math.isfinite(scales.growth_time):
        return scales.growth_time
    return AFTER_SETTLING * scales.stop_for(REMAINDER * scene.checks.steady_state.tolerance)


def _six_digits(seconds: float) -> float:
    """Round away what two eigenvalue routines may differ in, for the same deck on any machine."""
    return float(f"{seconds:.6g}")


def _points(scene: Scene, scales: TimeScales, engine: str) -> float:
    """Points on the period of the fastest ringing."""
    choice = scene.analysis
    if choice.points_per_period is not None:
        return choice.points_per_period
    if engine == "statespace":
        return RECORD_POINTS
    if choice.error is None:
        return POINTS_PER_PERIOD
    stop = _auto_stop(scene, scales) if choice.stop == "auto" else choice.stop
    return scales.max_step_for(1.0) / step_for_error(scales, choice.error, stop)


def truncation_for(points: float) -> float:
    """Return twice the local error ``(omega h)³ / 12`` of a mode with `points` on its period.

    So a mode that is faster than the one that sets the maximum step gets nearly as many points,
    and halving the step halves it everywhere.
    """
    return (2 * math.pi / points) ** 3 / 6
