"""Forecast of the step control of ngspice on a board, before ngspice runs.

ngspice (``CKTterr``) chooses every step h of the trapezoidal rule such that the local error of each
capacitor's charge q stays below a tolerance,

    h² |q'''| / 72 <= truncation · max(|q'|, max(|q|, charge) / h),

and never above a maximum step. The modes of a board give q at any time, so they give the step at
any time and the number of steps. They also give the error of the outputs: a step multiplies each
mode by ``(1 + hp/2) / (1 - hp/2)`` instead of ``exp(hp)``. No transient is simulated.

The forecast omits the start of ngspice (up to 50 steps). For a board with behavioural amplifiers,
and for the coarse board of a large board, the measured error is within a factor of 2 of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.subcircuits import STAGE_CAPACITANCE
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.engines.statespace.linearised.linear_board import (
    Initial,
    LinearBoard,
    initial_unknowns,
)
from taction.verification.engines.statespace.linearised.time_scales import GROWN, TimeScales

TINY = 1e-280  # in the place of zero
LARGEST = 300.0  # exponent
CKTTERR = 72.0  # 12 of the trapezoidal rule's local error times 3! of the divided difference
INSTANTS = 240  # number of instants of the forecast, in geometric progression
EARLIEST = 0.01  # of the fastest time constant: the first instant after 0
UNSEEN = 1e-9  # of the step amplitude: smaller modes are ignored at the outputs
FEWEST_STEPS = 50.0  # of a record; with more the mean cost of a board grows
FIRST = 0.1  # of the step that the charges allow at t = 0: the first step
FEWEST_INSTANTS = 200.0  # least number of instants of a record
MOST_INSTANTS = 500_000  # and the largest
MOVE = 0.02  # of the step amplitude: largest change of an output between two instants
CHARGE = 10.0  # times C times the step amplitude: above the charges of usual boards
EXPONENT = 1.5  # the truncation error is proportional to this power of the error
SEARCH_AIM = 0.93  # of the allowed error: target of each search step
CLOSE = 0.8  # of the allowed error: the search stops above this fraction
TRIES = 12
LEAST, START, MOST = 1e-15, 1e-6, 0.5  # truncation errors


class Forecast(NamedTuple):
    """A transient with its step control, and the forecast of its steps and error."""

    transient: Transient
    steps: float  # number of accepted steps
    error: float  # largest error of any output at any time, in step amplitudes


@dataclass(frozen=True, eq=False)
class StepModel:
    """The step control of one board over one record."""

    stop: float  # end of the record, s
    initial: Initial
    time: Floats  # (T,): s, from 0 to the end of the record
    poles: Complexes  # (n,): modes that show at the outputs, one of each conjugate pair, 1/s
    shares: Complexes  # (n, N): their amplitudes at the outputs, in step amplitudes
    # `all_poles`, `charges`: (m,) and (m, Q): all modes, and their amplitudes in every charge, 1/s
    # and C.
    all_poles: Complexes
    charges: Complexes
    rest: Floats  # (Q,): the charges at rest, C
    charge: float  # charge below which the truncation error is absolute, C
    amplitude: float  # step amplitude, V

    @classmethod
    def of(
        cls, board: LinearBoard, stop: float, initial: Initial = "zero", *, stable: bool = False
    ) -> StepModel:
        """Model the strain step of `board`, stable or not, up to `stop`, s."""
        coarse = board.descriptor.is_large
        board = board.coarse if coarse else board
        space, equations, rest = board.state_space, board.descriptor, board.equilibrium.values
        C, _ = space.rows(equations.names)
        deviation = initial_unknowns(board, initial) - rest
        kept = space.modes.centres.imag >= 0.0  # one of each conjugate pair, which counts twice
        poles, found = space.modes.centres[kept], space.modes.shares(C, deviation)
        modes = np.where(poles.imag > 0.0, 2.0, 1.0)[:, None] * found.amplitudes.T[kept]
        if coarse and stable:
            poles = -np.abs(poles.real) + 1j * poles.imag
        farads = np.ones(equations.size)
        farads[equations.node_count :] = STAGE_CAPACITANCE
        held = equations.dense.mass.T * farads
        charges = modes @ held
        charged = np.abs(charges).max(axis=0, initial=0.0) > 0.0
        outputs = [node for node in board.reported(None) if node in equations.places]
        places = [equations.places[node] for node in outputs]
        with np.errstate(over="ignore", invalid="ignore"):
            shares, errors = modes[:, places], found.errors[1][places].sum(axis=1)
        step = np.maximum(np.abs(shares.sum(axis=0).real), np.where(errors < np.inf, errors, 0.0))
        amplitude = float(step.max(initial=0.0))  # a smaller one is rounding
        largest = float(np.abs(shares).max(initial=0.0))
        if amplitude <= UNSEEN * largest:  # the outputs return to where they were
            amplitude = largest or 1.0
        shown = np.abs(shares).max(axis=1, initial=0.0) > UNSEEN * amplitude
        earliest = min(EARLIEST / float(np.abs(poles).max(initial=1.0 / stop)), 0.5 * stop)
        return cls(
            stop=stop,
            initial=initial,
            time=np.concatenate([[0.0], np.geomspace(earliest, stop, INSTANTS)]),
            poles=poles[shown],
            shares=shares[shown] / amplitude,
            all_poles=poles,
            charges=charges[:, charged],
            rest=(rest @ held)[charged],
            charge=CHARGE * board.circuit.charged_capacitance * amplitude,
            amplitude=amplitude,
        )

    @cached_property
    def growth(self) -> Complexes:
        """``exp(p t)`` of the modes that show, shape (T, n)."""
        return limited_exp(np.multiply.outer(self.time, self.poles))

    @cached_property
    def limits(self) -> tuple[Floats, Floats]:
        """The longest steps that charges and currents allow at a truncation error of 1, s, (T,)."""
        growth = limited_exp(np.multiply.outer(self.time, self.all_poles))
        first, second = (self.all_poles[:, None] ** k * self.charges for k in (1, 3))
        third = np.maximum(np.abs((growth @ second).real), TINY)
        size = np.maximum(np.abs((growth @ self.charges).real + self.rest), self.charge)
        by_charge = np.cbrt(CKTTERR * (size / third).min(axis=1, initial=self.charge / TINY))
        current = np.abs((growth @ first).real)
        by_current = np.sqrt(CKTTERR * (current / third).min(axis=1, initial=math.inf))
        return by_charge, by_current

    def forecast(self, truncation: float, max_step: float) -> Forecast:
        """Forecast the run of ngspice with a truncation error and a maximum step, s."""
        by_charge, by_current = self.limits
        longest = np.maximum(by_charge * truncation ** (1 / 3), by_current * truncation ** (1 / 2))
        step = np.minimum(longest, max_step)[:, None]
        drift = integral(slip(step, self.poles), self.time)
        off = limited_exp(np.multiply.outer(self.time, self.poles) + drift) - self.growth
        transient = Transient(
            self.stop,
            _six_digits(max_step),
            _six_digits(truncation),
            charge=_six_digits(self.charge),
            first_step=_six_digits(FIRST * float(step[0, 0])),
            initial=self.initial,
        )
        steps = float(integral(1.0 / step[:, 0], self.time)[-1])
        error = float(np.abs((off @ self.shares).real).max(initial=0.0))
        return Forecast(transient, steps, error)

    def even(self, max_step: float) -> Forecast:
        """Forecast a run with even steps of `max_step`, s; only faster modes get shorter steps."""
        truncation = (max_step * float(np.abs(self.poles.imag).max(initial=0.0))) ** 3 / 6.0
        return self.forecast(min(max(truncation / CHARGE, LEAST), MOST), max_step)

    def instants(self, error: float) -> Floats:
        """Return instants, s, whose cubic errs by `error`: ``h⁴ |d⁴u/dt⁴| 3/128``."""
        rate = np.abs(self.growth @ (self.poles[:, None] * self.shares)).max(axis=1, initial=TINY)
        bend = np.abs(self.growth @ (self.poles[:, None] ** 4 * self.shares))
        bend = np.maximum(bend.max(axis=1, initial=0.0), TINY)
        longest = np.minimum(self.time[-1] / FEWEST_INSTANTS, MOVE / rate)
        spacing = np.minimum((128.0 / 3.0 * error / bend) ** 0.25, longest)
        count = integral(1.0 / spacing, self.time)
        places = np.linspace(0.0, count[-1], min(math.ceil(count[-1]) + 1, MOST_INSTANTS))
        return np.asarray(np.interp(places, count, self.time))

    def cheapest(self, error: float) -> Forecast:
        """Return the largest truncation error whose forecast stays within `error`, or the least."""
        truncation = START
        for _ in range(TRIES):
            forecast = self.forecast(truncation, self.stop / FEWEST_STEPS)
            ratio = SEARCH_AIM * error / max(forecast.error, TINY)
            following = min(max(truncation * min(ratio, 1e12) ** EXPONENT, LEAST), MOST)
            if CLOSE * error <= forecast.error <= error or following == truncation:
                break
            truncation = following
        return forecast


def slip(step: Floats, poles: Complexes) -> Complexes:
    """Return ``(log((1 + z) / (1 - z)) - 2 z) / step`` with ``z = step poles / 2``, Im z >= 0."""
    z = 0.5 * step * poles
    ratio = (1.0 + z) / (1.0 - z)
    return np.asarray((np.log(np.where(ratio == 0.0, TINY, ratio)) - 2.0 * z) / step)


def integral(rate: Any, time: Floats) -> Any:
    """Integrate `rate`, (T,) or (T, n), over `time` by the trapezoidal rule; the same shape."""
    found = np.zeros_like(rate)
    np.cumsum((0.5 * (rate[1:] + rate[:-1])).T * np.diff(time), axis=-1, out=found[1:].T)
    return found


def limited_exp(exponents: Complexes) -> Complexes:
    """Return the exponential, limited to ``exp(LARGEST)``."""
    return np.asarray(np.exp(np.minimum(exponents.real, LARGEST) + 1j * exponents.imag))


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
UNSTABLE_PERIODS = 100.0  # of ringing: the same for the state-space engine, where it needs steps
EXACT_PERIODS = 20_000.0  # the same where it needs none: the record has `GROWING_POINTS` on each
GROWING_POINTS = 10.0  # on a period: fewer would show ringing at another frequency
TOO_LONG = "the record ends after {}, before the instability has grown"


@dataclass(frozen=True, slots=True)
class TransientPlan:
    """A transient and the forecast of its error and cost."""

    transient: Transient  # the transient to simulate
    wanted: float  # largest error of any output at any time that the checks allow, in steps
    tolerance: float  # of the state-space engine's steps, in step amplitudes
    growing: bool  # whether the board is unstable and its outputs grow
    notes: tuple[str, ...] = ()  # what the plan omits, for the user
    # `steps`, `error`, `seconds`: of ngspice, by the forecast: its steps, its error, in step
    # amplitudes, and its processor time, s; 0 for an engine that bounds its own error.
    steps: float = 0.0
    error: float = 0.0
    seconds: float = 0.0

    def instants(self, board: LinearBoard) -> Floats | None:
        """Return dense instants of a state-space record, s; None if the outputs grow."""
        if self.growing:
            return None
        model = StepModel.of(board, self.transient.stop, self.transient.initial, stable=True)
        return model.instants(RECORD_ERROR)


def state_space_tolerance(wanted: float) -> float:
    """Return the tolerance of the state-space engine's steps; their errors add up."""
    return min(max(STEP_SHARE * wanted, LEAST_TOLERANCE), MOST_TOLERANCE)


def wanted_error(scene: Scene) -> float:
    """Return the error of the transient that the scene allows, in step amplitudes."""
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
    growing: bool = False,
    resolution: float = 0.0,
    stop: float | None = None,
    aim: float | None = None,
) -> TransientPlan:
    """Choose the length of the record and the cheapest step control for the wanted error.

    `steps`: whether the engine takes the steps of the plan. `growing`: whether the board is
    unstable. `resolution`: rounding error of the poles, 1/s; modes that are slower do not lengthen
    the record. `stop`: its length, s, by default that of the scene. `aim`: error to plan for, in
    step amplitudes, by default `AIM` times the wanted error. EngineError: no mode of the board is
    visible at its outputs.
    """
    wanted, linear = wanted_error(scene), board.circuit.is_linear
    tolerance, curved = state_space_tolerance(wanted), board.circuit.has_nonlinear_amplifiers
    made = partial(
        TransientPlan,
        wanted=wanted,
        tolerance=min(tolerance, CURVED_TOLERANCE) if curved else tolerance,
        growing=growing,
    )
    initial, points = scene.analysis.initial, scene.analysis.points_per_period
    if stop is None:
        stop = record_length(scene, scales, resolution, growing=growing)
    notes: tuple[str, ...] = ()
    if not steps:  # a growing run shows every period, and is kept short
        longest = UNSTABLE_PERIODS if not linear or board.descriptor.is_large else EXACT_PERIODS
        longest *= scales.max_step_for(1.0)
        if growing and stop > longest:
            stop, notes = longest, (TOO_LONG.format(show(longest, "s", 3)),)
        spacing = min(stop, scales.max_step_for(GROWING_POINTS)) if growing else stop
        return made(Transient(stop, spacing, initial=initial), notes=notes)
    model = StepModel.of(board, stop, initial, stable=not growing)
    size = max(len(board.circuit.signal_nodes), len(board.circuit.constraint_nodes))
    step_seconds = (LINEAR_STEP * size + MATRIX_STEP * size**3) * (1.0 if linear else NEWTON)
    if points is not None:
        found = model.even(scales.max_step_for(points))
    elif growing:
        found = model.cheapest(GROWTH_ERROR * GROWN)
        if (seconds := found.steps * step_seconds) > UNSTABLE_SECONDS:
            stop *= UNSTABLE_SECONDS / seconds
            why = f"ngspice needs {UNSTABLE_SECONDS:g} s"
            notes = (f"{TOO_LONG.format(show(stop, 's', 3))}: {why}",)
            found = StepModel.of(board, stop, initial).cheapest(GROWTH_ERROR)
    else:
        allowed = max(AIM * wanted if aim is None else aim, LEAST_ERROR)
        found = model.cheapest(allowed)
        if board.descriptor.devices.steepest.any():  # their slopes jump
            found = _from_start(board, model, found, allowed)
    seconds = found.steps * step_seconds
    return made(found.transient, notes=notes, steps=found.steps, error=found.error, seconds=seconds)


def _from_start(board: LinearBoard, model: StepModel, rest: Forecast, allowed: float) -> Forecast:
    """Return a step control that also follows the board where its amplifiers start."""
    try:
        begin = board.at_start(model.initial)
        start = StepModel.of(begin, model.stop, model.initial)
    except EngineError:
        return rest
    if not start.poles.size or not np.all(begin.state_space.modes.poles.real < 0.0):
        return rest
    share = min(1.0, model.amplitude / start.amplitude)
    other = start.cheapest(max(share * allowed, LEAST_ERROR))
    names = ("truncation", "charge", "max_step", "first_step")
    both = rest.transient, other.transient
    least = {name: min(getattr(each, name) for each in both) for name in names}
    error = max(rest.error, other.error / share)
    return Forecast(replace(rest.transient, **least), max(rest.steps, other.steps), error)


def record_length(
    scene: Scene, scales: TimeScales, resolution: float = 0.0, *, growing: bool = False
) -> float:
    """Return the length, s, of a record that grows, or in which every check is decided."""
    checks = scene.checks
    if scene.analysis.stop != "auto":
        return scene.analysis.stop
    if growing and math.isfinite(scales.growth_time):
        return _six_digits(scales.growth_time)
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


def truncation_for(points: float) -> float:
    """Return twice the local error ``(omega h)³ / 12`` of a mode with `points` on its period."""
    return (2 * math.pi / points) ** 3 / 6
