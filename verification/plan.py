"""How long to simulate a board and how finely, from its own time scales."""

from __future__ import annotations

import math
from dataclasses import replace

from netlist_gen.analysis import Transient
from netlist_gen.scene import Scene
from spice_models.errors import Complaint, EngineError, InputError
from verification.timescales import TimeScales

REMAINDER = 0.1  # of the steady-state tolerance: what may still ring when the record ends
MAX_POINTS = 2_000_000
AFTER_SETTLING = 1.2  # a settled record must also show that it stays so
FEWEST_POINTS = 50  # in a record
FEWEST_PERIODS = 8  # of ringing in a record, however fast it settles or grows


def plan_transient(scene: Scene, scales: TimeScales) -> Transient:
    """Choose stop time and maximum step of the transient of `scene`.

    The stop time follows the slowest mode that matters, down to a tenth of the steady-state
    tolerance (or the growth of an unstable one); the step follows the fastest ringing.

    Raises
    ------
    EngineError
        The two are so far apart that the run would never end; the message says what to change.
    InputError
        ``analysis.stop`` is shorter than one step.
    """
    points = scene.analysis.points_per_period
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
            " analysis.stop or fewer analysis.points_per_period to look at a part of it"
        )
    if scene.analysis.stop == "auto":
        stop = _six_digits(stop)
    return Transient(stop, _six_digits(step), _truncation(points), scene.analysis.initial)


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


def _truncation(points: float) -> float:
    """Return twice the local error ``(omega h)³ / 12`` of a mode with `points` on its period.

    So a mode that is faster than the one that sets the maximum step gets nearly as many points,
    and halving the step halves it everywhere.
    """
    return (2 * math.pi / points) ** 3 / 6
