"""How long a board is simulated and how finely: the cheapest transient that the checks allow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from netlist_gen.analysis import Transient
from netlist_gen.scene.scene import Checks, Scene
from spice_models.array_types import Floats
from spice_models.errors import Complaint, EngineError, InputError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.small_signal.step_forecast import StepForecast, StepModel
from verification.small_signal.time_scales import GROWN, TimeScales

REMAINDER = 0.1  # of the steady-state tolerance: what may still ring when the record ends
AFTER_SETTLING = 1.2  # a settled record must also show that it stays so
SHARE = 0.25  # of the tightest tolerance of the checks: the error wanted by ``error = "auto"``
AIM = 0.8  # of the wanted error: what a transient is planned for
LEAST_ERROR = 1e-8  # of the step amplitude: no transient of ngspice is planned for less
GROWTH_ERROR = 0.01  # of the height at which an instability counts as seen
FEWEST_PERIODS = 8  # of ringing in a record, however fast it settles
RECORD_ERROR = 2e-8  # of the step amplitude: what reading a record between its points may add
UNSTABLE_SECONDS = 2.0  # of processor time that a board is simulated that is known to be unstable
LINEAR_STEP, MATRIX_STEP = 2.7e-6, 3.1e-9
"""Processor time of a step of ngspice 46 with KLU: ``LINEAR_STEP N + MATRIX_STEP N³``, s, measured
for N = 7 to 128 on one machine; behavioural amplifiers make a step `NEWTON` times as dear."""
NEWTON = 2.5
NO_STEPS = StepForecast(0.0, 0.0, 0.0, 0.0, steps=0.0, error=0.0)
TOO_SLOW = (
    "the record ends after {stop:.3g} s, before the instability has grown: ngspice takes"
    " {seconds:g} s for that record"
)


@dataclass(frozen=True, slots=True)
class Plan:
    """A transient and what is expected of it.

    Attributes
    ----------
    transient : Transient
        What the engine is asked for.
    wanted : float
        Largest error of any output at any time, in step amplitudes, that the checks allow.
    forecast : StepForecast
        What ngspice's step control will do; `NO_STEPS` for the state-space engine.
    seconds : float
        Processor time that ngspice will take, s: an estimate.
    growing : bool
        Whether the board is unstable and its outputs grow.
    notes : tuple of str
        What the plan leaves out.
    """

    transient: Transient
    wanted: float
    forecast: StepForecast
    seconds: float
    growing: bool
    notes: tuple[str, ...] = ()

    def instants(self, board: LinearBoard) -> Floats | None:
        """Return the instants of a record of the state-space engine, s; None if it grows.

        They are dense where the outputs bend, so that a cubic between them errs by about
        `RECORD_ERROR`.
        """
        if self.growing:
            return None
        model = StepModel.of(board, self.transient.stop, self.transient.initial)
        return model.instants(RECORD_ERROR)


def wanted_error(scene: Scene) -> float:
    """Return the largest error of the transient that the scene allows, in step amplitudes.

    ``analysis.error``, or with ``"auto"`` the share `SHARE` of the tightest of: the tolerances of
    the steady state and of the comparison of engines, the settling band, the overshoot limit.
    """
    error = scene.analysis.error
    return SHARE * tightest(scene.checks) if error == "auto" else error


def tightest(checks: Checks) -> float:
    """Return the smallest limit of `checks` that is a fraction of the step amplitude."""
    limits = [
        checks.steady_state.tolerance,
        checks.engines_agree.limit,
        checks.settling_time.band,
    ]
    if checks.overshoot is not None and checks.overshoot.max > 0.0:
        limits.append(checks.overshoot.max)
    return min(limits)


def plan_transient(
    scene: Scene,
    board: LinearBoard,
    scales: TimeScales,
    engine: str = "ngspice",
    *,
    aim: float | None = None,
) -> Plan:
    """Choose the record's length and the cheapest step control for the wanted error.

    With ``stop = "auto"`` a record ends when all that still rings is a tenth of the steady-state
    tolerance, or when an instability has grown. ``analysis.points_per_period`` replaces the search
    of a step control by even steps. The state-space engine needs no step control.

    Parameters
    ----------
    aim : float, optional
        Error to plan for, in step amplitudes, in the place of `AIM` of the wanted one.

    Raises
    ------
    EngineError
        No mode of the board shows at its outputs.
    InputError
        ``analysis.stop`` is shorter than the fastest visible time scale.
    """
    stop, error, initial = _stop(scene, scales), wanted_error(scene), scene.analysis.initial
    growing = math.isfinite(scales.growth_time)
    if engine == "statespace":
        return Plan(Transient(stop, stop, initial=initial), error, NO_STEPS, 0.0, growing)
    model, points = StepModel.of(board, stop, initial), scene.analysis.points_per_period
    each = seconds_per_step(board)
    notes: tuple[str, ...] = ()
    if points is not None:
        forecast = model.even(scales.max_step_for(points))
    elif growing:
        forecast = model.cheapest(GROWTH_ERROR * GROWN)
        if forecast.steps * each > UNSTABLE_SECONDS:
            stop = model.reached(forecast, UNSTABLE_SECONDS / each)
            notes = (TOO_SLOW.format(stop=stop, seconds=UNSTABLE_SECONDS),)
            forecast = StepModel.of(board, stop, initial).cheapest(GROWTH_ERROR)
    else:
        forecast = model.cheapest(max(AIM * error if aim is None else aim, LEAST_ERROR))
    transient = Transient(
        stop=stop,
        max_step=_six_digits(forecast.max_step),
        truncation=_six_digits(forecast.truncation),
        charge=_six_digits(forecast.charge),
        first_step=_six_digits(forecast.first_step),
        initial=initial,
    )
    return Plan(transient, error, forecast, forecast.steps * each, growing, notes)


def seconds_per_step(board: LinearBoard) -> float:
    """Estimate the processor time of one step of ngspice, s."""
    channels = len(board.circuit.signal_nodes)
    linear = LINEAR_STEP * channels + MATRIX_STEP * channels**3
    return NEWTON * linear if board.circuit.amplifiers else linear


def even_transient(scene: Scene, scales: TimeScales, points: float, stop: float) -> Transient:
    """Return a transient of even steps, `points` on the period of the fastest ringing."""
    step = scales.max_step_for(points)
    return Transient(stop, step, truncation_for(points), initial=scene.analysis.initial)


def truncation_for(points: float) -> float:
    """Return twice the local error ``(omega h)³ / 12`` of a mode with `points` on its period.

    So a mode that is faster than the one that sets the maximum step gets nearly as many points,
    and halving the step halves it everywhere.
    """
    return (2 * math.pi / points) ** 3 / 6


def coarser(transient: Transient, ratio: float) -> Transient:
    """Return the same transient with every step `ratio` times as long (trapezoidal rule)."""
    return replace(
        transient,
        max_step=ratio * transient.max_step,
        truncation=ratio**3 * transient.truncation,
        first_step=ratio * transient.begin,
    )


def _stop(scene: Scene, scales: TimeScales) -> float:
    stop = scene.analysis.stop
    if stop != "auto":
        fastest = scales.max_step_for(2.0 * math.pi)
        if stop < fastest < math.inf:
            text = f"shorter than {fastest:.3g} s, in which the outputs move; longer, or 'auto'"
            raise InputError(scene.file, Complaint("analysis.stop", f"{stop!r} s", text))
        return stop
    if math.isfinite(scales.growth_time):
        return _six_digits(scales.growth_time)
    settled = AFTER_SETTLING * scales.stop_for(REMAINDER * scene.checks.steady_state.tolerance)
    longest = max(settled, FEWEST_PERIODS * scales.max_step_for(1.0))
    if not (math.isfinite(longest) and longest > 0.0):
        raise EngineError("no mode of this board shows at its outputs: there is nothing to time")
    return _six_digits(longest)


def _six_digits(value: float) -> float:
    """Round away what two eigenvalue routines may differ in, for the same deck on any machine."""
    return float(f"{value:.6g}")
