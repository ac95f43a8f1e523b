"""Length and step control of a transient: the cheapest that the checks allow, or even steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.scene.check_keys import Checks
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.engines.statespace.linearised.linear_board import Initial, LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import GROWN, TimeScales
from taction.verification.verdict.step_forecast import StepForecast, StepModel

REMAINDER = 0.1  # of the steady-state tolerance and the band: remaining ringing at the end
AFTER_SETTLING = 1.2  # times the settling time: the record must show that outputs remain settled
SHARE = 0.25  # of the tightest tolerance of the checks: the error wanted by ``error = "auto"``
AIM = 0.8  # of the wanted error: the error that a transient is planned for
STEP_SHARE = 0.2  # of a wanted error: the tolerance of the state-space engine
CURVED_TOLERANCE = 1e-6  # most where amplifiers are curved: then two runs find readings to `FOUND`
LEAST_TOLERANCE, MOST_TOLERANCE = 1e-10, 1e-3  # limits set by rounding and by convergence
LEAST_ERROR = 1e-8  # of the step amplitude: the least error that ngspice is planned for
GROWTH_ERROR = 0.01  # of `GROWN`: the error that a growing transient is planned for
FEWEST_PERIODS = 8  # of ringing in every record
RECORD_ERROR = 2e-8  # of the step amplitude: error of interpolation between points of a record
UNSTABLE_SECONDS = 2.0  # of processor time: limit for a board that is known to be unstable
LINEAR_STEP, MATRIX_STEP = 2.7e-6, 3.1e-9
"""Processor time of a step of ngspice 46 with KLU: ``LINEAR_STEP N + MATRIX_STEP N³``, s, measured
for N = M = 7 to 128 on one machine (else N is the larger of the two); with behavioural amplifiers a
step takes `NEWTON` times as long."""
NEWTON = 2.5
LONG = 10.0  # s: a longer run is announced
SHORTER = "the state-space engine (--engine statespace) is usually faster"
NO_STEPS = StepForecast(0.0, 0.0, 0.0, 0.0, steps=0.0, error=0.0)
UNSTABLE_PERIODS = 100.0  # of ringing: the same for the state-space engine, where it needs steps
EXACT_PERIODS = 20_000.0  # the same where it needs none: the record has `GROWING_POINTS` on each
GROWING_POINTS = 10.0  # on a period: fewer would show ringing at another frequency
TOO_LONG = "the record ends after {stop}, before the instability has grown"
TOO_SLOW = (
    "the record ends after {stop}, before the instability has grown: ngspice needs"
    " {seconds:g} s up to there"
)


@dataclass(frozen=True, slots=True)
class TransientPlan:
    """A transient and the forecast of its error and cost."""

    transient: Transient  # the transient to simulate
    # Largest error of any output at any time that the checks allow, in step amplitudes.
    wanted: float
    # What ngspice's step control will do; `NO_STEPS` for the state-space engine.
    forecast: StepForecast
    seconds: float  # estimated processor time of ngspice, s
    growing: bool  # whether the board is unstable and its outputs grow
    grown: float  # length of the shortest record that shows a growing instability, s
    notes: tuple[str, ...] = ()  # what the plan omits, for the user
    curved: bool = False  # whether the board has behavioural amplifiers or transistors

    @property
    def by_steps(self) -> bool:
        """Whether the engine takes the steps of the forecast; not one that bounds its own error."""
        return self.forecast is not NO_STEPS

    @property
    def tolerance(self) -> float:
        """Tolerance of the state-space engine's steps, in step amplitudes."""
        most = CURVED_TOLERANCE if self.curved else math.inf
        return min(state_space_tolerance(self.wanted), most)

    @property
    def remark(self) -> str:
        """How long ngspice will take, if it takes long; else empty."""
        if self.seconds < LONG:
            return ""
        return f"about {self.seconds:.0f} s for {self.forecast.steps:.2g} steps; {SHORTER}"

    def instants(self, board: LinearBoard) -> Floats | None:
        """Return the instants of a state-space record, s, dense where the outputs bend.

        None if the outputs grow.
        """
        if self.growing:
            return None
        model = StepModel.of(board, self.transient.stop, self.transient.initial, stable=True)
        return model.instants(RECORD_ERROR)


def state_space_tolerance(wanted: float) -> float:
    """Return the tolerance of the state-space engine's steps for an error of `wanted`.

    Step errors add up over the periods of ringing, so the tolerance is well below `wanted`.
    """
    return min(max(STEP_SHARE * wanted, LEAST_TOLERANCE), MOST_TOLERANCE)


def wanted_error(scene: Scene) -> float:
    """Return the largest error of the transient that the scene allows, in step amplitudes.

    ``analysis.error``, or with ``"auto"`` the share `SHARE` of the tightest limit.
    """
    if scene.analysis.error != "auto":
        return scene.analysis.error
    checks = scene.checks
    tolerances = checks.steady_state.tolerance, checks.engines_agree.limit
    excursions = (getattr(checks, name) for name in EXCURSIONS)
    limits: list[float] = [each.max for each in excursions if each is not None and each.max > 0.0]
    return SHARE * min(*tolerances, checks.settling_time.band, *limits)


def plan_transient(
    scene: Scene,
    board: LinearBoard,
    scales: TimeScales,
    *,
    steps: bool = True,
    stable: bool | None = None,
    resolution: float = 0.0,
    aim: float | None = None,
) -> TransientPlan:
    """Choose the length of the record and the cheapest step control for the wanted error.

    `steps`: whether the engine takes the steps of the plan. `stable`: whether the board is stable;
    by default as `scales` say. `resolution`: rounding error of the poles, 1/s; modes that are
    slower do not lengthen the record. `aim`: error to plan for, in step amplitudes, by default
    `AIM` times the wanted error. EngineError: no mode of the board is visible at its outputs.
    """
    growing = math.isfinite(scales.growth_time) if stable is None else not stable
    stop, wanted = _stop(scene, scales, resolution, growing=growing), wanted_error(scene)
    initial, points = scene.analysis.initial, scene.analysis.points_per_period
    notes: tuple[str, ...] = ()
    forecast, seconds = NO_STEPS, 0.0
    if steps:
        model = StepModel.of(board, stop, initial, stable=not growing)
        step_seconds = seconds_per_step(board)
        if points is not None:
            forecast = model.even(scales.max_step_for(points))
        elif growing:
            forecast = model.cheapest(GROWTH_ERROR * GROWN)
            if forecast.steps * step_seconds > UNSTABLE_SECONDS:
                stop = model.reached(forecast, UNSTABLE_SECONDS / step_seconds)
                notes = (TOO_SLOW.format(stop=show(stop, "s", 3), seconds=UNSTABLE_SECONDS),)
                forecast = StepModel.of(board, stop, initial).cheapest(GROWTH_ERROR)
        else:
            allowed = max(AIM * wanted if aim is None else aim, LEAST_ERROR)
            forecast = model.cheapest(allowed)
            if any(board.broken):
                forecast = _also_from_start(board, model, initial, forecast, allowed)
        seconds = forecast.steps * step_seconds
        transient = Transient(
            stop,
            _six_digits(forecast.max_step),
            _six_digits(forecast.truncation),
            charge=_six_digits(forecast.charge),
            first_step=_six_digits(forecast.first_step),
            initial=initial,
        )
    else:  # a growing run shows every period, and is kept short
        stepped = not board.circuit.is_linear or board.descriptor.is_large
        longest = (UNSTABLE_PERIODS if stepped else EXACT_PERIODS) * scales.max_step_for(1.0)
        if growing and stop > longest:
            stop, notes = longest, (TOO_LONG.format(stop=show(longest, "s", 3)),)
        spacing = min(stop, scales.max_step_for(GROWING_POINTS)) if growing else stop
        transient = Transient(stop, spacing, initial=initial)
    grown, curved = min(scales.growth_time, stop), board.circuit.has_nonlinear_amplifiers
    return TransientPlan(transient, wanted, forecast, seconds, growing, grown, notes, curved)


def _also_from_start(
    board: LinearBoard, model: StepModel, initial: Initial, rest: StepForecast, allowed: float
) -> StepForecast:
    """Return a step control that also follows the board with its amplifiers' slopes of the start.

    Where all amplifiers saturate at rest, the modes at rest do not show how the board gets there.
    """
    try:
        begin = board.at_start(initial)
        start = StepModel.of(begin, float(model.time[-1]), initial)
    except EngineError:
        return rest
    if not start.poles.size or not np.all(begin.state_space.modes.poles.real < 0.0):
        return rest
    share = min(1.0, model.amplitude / start.amplitude)
    other = start.cheapest(max(share * allowed, LEAST_ERROR))
    names = ("truncation", "charge", "max_step", "first_step")
    least = {name: min(getattr(rest, name), getattr(other, name)) for name in names}
    most = {"steps": max(rest.steps, other.steps), "error": max(rest.error, other.error / share)}
    return StepForecast(**least, **most)


def seconds_per_step(board: LinearBoard) -> float:
    """Estimate the processor time of one step of ngspice, s."""
    size = max(len(board.circuit.signal_nodes), len(board.circuit.constraint_nodes))
    linear = LINEAR_STEP * size + MATRIX_STEP * size**3
    return linear if board.circuit.is_linear else NEWTON * linear


def _stop(scene: Scene, scales: TimeScales, resolution: float, *, growing: bool) -> float:
    if scene.analysis.stop != "auto":
        return scene.analysis.stop
    if growing and math.isfinite(scales.growth_time):
        return _six_digits(scales.growth_time)
    return settled_after(scene.checks, scales, resolution)


def settled_after(checks: Checks, scales: TimeScales, resolution: float = 0.0) -> float:
    """Return the length of a record in which every check of a stable board can be decided, s.

    EngineError: no mode of the board is visible at its outputs.
    """
    remainder = REMAINDER * min(checks.steady_state.tolerance, checks.settling_time.band)
    settled = AFTER_SETTLING * scales.stop_for(remainder, slowest=resolution)
    longest = max(settled, FEWEST_PERIODS * scales.max_step_for(1.0))
    if not (math.isfinite(longest) and longest > 0.0):
        raise EngineError(
            "no mode of this board is visible at its outputs, so no stop time can be chosen"
        )
    return _six_digits(longest)


def _six_digits(value: float) -> float:
    """Round to six digits, so that rounding of the eigenvalues does not change the deck."""
    return float(f"{value:.6g}")


def even_transient(scene: Scene, scales: TimeScales, points: float, stop: float) -> Transient:
    """Return a transient of even steps, `points` on the period of the fastest ringing."""
    step = scales.max_step_for(points)
    return Transient(stop, step, truncation_for(points), initial=scene.analysis.initial)


def truncation_for(points: float) -> float:
    """Return twice the local error ``(omega h)³ / 12`` of a mode with `points` on its period."""
    return (2 * math.pi / points) ** 3 / 6


def coarser(transient: Transient, ratio: float) -> Transient:
    """Return the same transient with every step `ratio` times as long (trapezoidal rule)."""
    return replace(
        transient,
        max_step=ratio * transient.max_step,
        truncation=ratio**3 * transient.truncation,
        first_step=ratio * transient.begin,
    )
