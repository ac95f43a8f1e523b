"""A board without a scene as the state-space engine sees it: poles, readings, noise, its record.

What is missing is a reference solution, so the outputs are compared with their own equilibrium. A
check, a sweep, a comparison and the samples of a yield all measure their boards here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from taction.netlist_gen.board.circuit import Output
from taction.netlist_gen.scene.checks import LOWEST
from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError, InputError
from taction.system.quantities import show_rate
from taction.system.reading_definitions import READINGS
from taction.verification.engines.statespace.linearised.board import LinearBoard, solve_together
from taction.verification.engines.statespace.linearised.output_noise import output_noise
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.readings.course import Course
from taction.verification.readings.exact_measures import ExactResponse, measure_responses
from taction.verification.readings.exact_signal import ExactSignal
from taction.verification.readings.measurements import Measurements, channel_measure, summary
from taction.verification.readings.readings import Reading, unread
from taction.verification.readings.settling import ChannelState, Settlement
from taction.verification.stability.instant_feedback import latching
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import Poles, poles
from taction.verification.stability.shown_poles import PolesApart, told_apart
from taction.verification.studies.wanted_checks import Wanted
from taction.verification.verdict.cause import cause
from taction.verification.verdict.checks import (
    Check,
    Evidence,
    Outcome,
    at_most,
    doubtful,
    overall,
)
from taction.verification.verdict.companion import Agreement, step_error
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.planned_board import SteadyState
from taction.verification.verdict.record import (
    STATES,
    Channel,
    Figure,
    FigureRule,
    Record,
    finite,
    three,
)
from taction.verification.verdict.run_checks import run_checks

WANTED = 1e-4  # error of ngspice's transient, in step amplitudes
DETAIL = 1e-3  # of the largest mode: one that the first grid resolves
DRAWN = 1000  # instants of a drawn response, early and late
EARLIEST = 1e-4  # of a drawn response: its first instant after 0
NO_RISE = "the output returns to where it was: it has no step"
UNSTABLE = "the board is not stable"
FAR = "the model itself grows beyond the band of 10 GHz"
OSCILLATOR = "for an oscillator: --check oscillates"
LATCH = "positive feedback makes it latch, as exchanged inputs of an op-amp do"
Start = Literal["zero", "rest"]


@dataclass(frozen=True, eq=False)
class MeasuredBoard:
    """A linear board, its poles, and the step of its outputs against their own equilibrium.

    Attributes
    ----------
    initial : str
        Whether the step begins at rest, or with no charge.
    before, rest : ndarray (N,)
        Outputs before the step and at rest, V.
    rest_error : float
        Bound on the error of `rest`, V.
    apart : PolesApart
        Poles that do not decide: no output shows them, or they are those of a model.
    """

    board: LinearBoard
    initial: Start
    poles: Poles
    measurements: Measurements
    before: Floats
    rest: Floats
    rest_error: float
    apart: PolesApart = field(default_factory=PolesApart)

    @cached_property
    def scales(self) -> TimeScales:
        """The time scales of its modes."""
        return time_scales(self.board, initial=self.initial)

    def noise(self, lowest: float | None) -> OutputNoise:
        """Return the noise of its outputs above a frequency, Hz; or why it is not known.

        Where one output has none, the others are known by themselves, and this one is NaN.
        """
        if not self.poles.known_stable or self.apart.beyond:
            return OutputNoise(unknown="only a board that is known to be stable has noise at rest")
        models = self.board.circuit.models.values()
        low = lowest or (LOWEST if any(model.flicker_noise > 0.0 for model in models) else 0.0)
        try:
            rms, error = output_noise(self.board, low)
            return OutputNoise(tuple(rms.tolist()), tuple(error.tolist()), lowest=low)
        except EngineError as problem:
            if len(self.board.circuit.outputs) == 1:
                return OutputNoise(unknown=str(problem))
        each = [self._noise_of(out, low) for out in self.board.circuit.outputs]
        reasons: dict[str, list[str]] = {}
        for out, (_, _, why) in zip(self.board.circuit.outputs, each, strict=True):
            if why:
                reasons.setdefault(why.replace(f" of output {out.node}", ""), []).append(out.node)
        return OutputNoise(
            tuple(rms for rms, _, _ in each),
            tuple(error for _, error, _ in each),
            unknown="; ".join(f"{', '.join(nodes)}: {why}" for why, nodes in reasons.items()),
            lowest=low,
        )

    def _noise_of(self, out: Output, low: float) -> tuple[float, float, str]:
        """Return the noise of one output and its bound, V; or NaN, and why it is not known."""
        try:
            rms, error = output_noise(LinearBoard(replace(self.board.circuit, outputs=(out,))), low)
        except EngineError as problem:
            return math.nan, math.nan, str(problem)
        return float(rms[0]), float(error[0]), ""

    def checks(
        self,
        asked: Wanted,
        noise: OutputNoise | None,
        margin: Margin | None = None,
        agreement: Agreement | None = None,
    ) -> Iterator[Check]:
        """Yield the expected values, then the limits that were asked for."""
        yield from (self._expected(*each) for each in asked.expected)
        evidence = Evidence(
            checks=asked.limits,
            measurements=self.measurements,
            error=step_error(self.measurements, 0.0),
            steady=SteadyState.of(self.board, self.scales),
            end=math.inf,
            forever=True,
            wanted=WANTED,
            agreement=agreement,
            poles=self.poles,
            margin=margin if asked.limits.stability.margin > 1.0 else None,
            reference_error=0.0,
            reference_problem="",
            noise=noise,
        )
        named = {*asked.names, *(["engines_agree"] if agreement is not None else [])}
        for check in run_checks(evidence):
            if check.name == "stability" and evidence.growth:
                check = replace(check, reason=f"{check.reason}; {self.remedy}")
            if check.name in named:
                yield check
        if asked.oscillates:
            yield _oscillates(self.poles)

    @property
    def remedy(self) -> str:
        """What to look at where the board is not stable."""
        hint = OSCILLATOR if self.poles.rightmost.imag else LATCH
        return f"no node that you look at shows it; {hint}" if self.apart.unseen else hint

    def _expected(self, node: str, volts: float, tolerance: float) -> Check:
        """Compare the equilibrium of a node with an expected value."""
        name, place = f"v({node})", self.board.descriptor.place(node)
        value, error = (
            float(self.board.equilibrium.values[place]),
            float(self.board.rounding[place]),
        )
        error = max(error, EPS * abs(value))
        if not self.poles.known_stable:
            reason = "the board is not stable: it does not come to rest there"
            outcome = Outcome.FAIL if self.poles.known_unstable else Outcome.INCONCLUSIVE
            return Check(name, outcome, value, error, volts, tolerance, "V", reason)
        outcome = at_most(abs(value - volts), error, tolerance)
        return Check(name, outcome, value, error, volts, tolerance, "V", "equilibrium")

    def record(
        self,
        checks: Iterable[Check] = (),
        noise: OutputNoise | None = None,
        margin: Margin | None = None,
    ) -> Record:
        """Return what is known as a record; its outcome is that of the checks."""
        found, judged = self.measurements, tuple(checks)
        lead = self.poles.rightmost if len(self.poles.poles) else None
        bound = finite(self.poles.resolution)
        figures = {
            **{name: _figure(name, each) for name, each in found.readings.items()},
            "growth_rate": Figure(None if lead is None else lead.real, "1/s", bound),
            "frequency": Figure(
                None if lead is None else abs(lead.imag) / math.tau,
                "Hz",
                None if bound is None else bound / math.tau,
            ),
            "step_amplitude": Figure(found.amplitude, "V", 2.0 * self.rest_error),
            "margin": Figure(None if margin is None else margin.factor),
            "noise": Figure(None if noise is None else noise.known, "V"),
        }
        decisive = cause(judged)
        return Record(
            overall(judged).value if judged else Outcome.PASS.value,
            "statespace",
            "statespace",
            None,
            "" if decisive is None else decisive.text,
            max((each.state for each in found.channels), key=STATES.index).value,
            self.poles.stable,
            *three(figures),
            judged,
            tuple(
                Channel.of(channel, {"equilibrium": Figure(value, "V", self.rest_error)})
                for channel, value in zip(found.channels, self.rest.tolist(), strict=True)
            ),
        )

    def curve(self, until: float = math.inf) -> tuple[Floats, Floats] | None:
        """Return instants and outputs of the step, (K,) and (K, N), to be drawn; None without.

        They end where the board has settled or has grown, or at `until`, s.
        """
        stop = min(self.scales.stop, self.scales.growth_time, until)
        if not (math.isfinite(stop) and stop > 0.0):
            return None
        late = np.linspace(0.0, stop, DRAWN)
        time = np.union1d(late, np.geomspace(EARLIEST * stop, stop, DRAWN))
        try:
            solution = exact_solution(self.board, initial=self.initial)
        except EngineError:
            return None
        return time, solution.at(time) * _signs(self.board)


def _oscillates(found: Poles) -> Check:
    """Pass a board in which a complex pair grows, and no real pole.

    The value is the frequency of the fastest growing pair; how far the board swings, and how much
    this moves the frequency, its linear model does not say.
    """

    def check(outcome: Outcome, reason: str, pole: complex = 0.0, error: float = 0.0) -> Check:
        value, bound = (abs(pole.imag) / math.tau, error / math.tau) if pole else (None, None)
        return Check("oscillates", outcome, value, bound, None, None, "Hz", reason)

    p, errors = found.poles, found.errors
    growing, may_grow = p.real > errors, p.real >= -errors
    pairs, real = np.abs(p.imag) > errors, p.imag == 0.0
    if np.any(growing & real):
        return check(Outcome.FAIL, f"runs away, a real pole grows: {LATCH}")
    if np.any(may_grow & ~pairs) or (np.any(may_grow) and not np.any(growing)):
        return check(Outcome.INCONCLUSIVE, doubtful(found))
    if not np.any(growing):
        return check(Outcome.FAIL, "every mode decays")
    first = int(np.argmax(growing))
    reason = f"grows with {show_rate(p.real[first])}; of its start, before anything limits it"
    return check(Outcome.PASS, reason, complex(p[first]), float(errors[first]))


def _figure(name: str, reading: Reading | None) -> Figure:
    rule: FigureRule[Reading | None] = FigureRule(READINGS[name].unit, lambda each: each)
    return rule.figure(reading)


def measure_board(board: LinearBoard, initial: Start, band: float) -> MeasuredBoard:
    """Return one measured board; `band` is that of the settling time.

    Raises
    ------
    EngineError
        No equilibrium, no state-space form, or no exact solution.
    """
    found, response = _begun(board, initial, band)
    return _measured([found], [response])[0]


def measure_boards(
    boards: Iterable[LinearBoard | Exception], initial: Start, band: float
) -> list[MeasuredBoard | Exception]:
    """Return measured boards, with the error of each one that cannot be measured in its place.

    Boards of one structure are linearised, and those of equally many outputs measured, by the same
    array operations.
    """
    boards = list(boards)
    solve_together([board for board in boards if isinstance(board, LinearBoard)])
    results: list[MeasuredBoard | Exception] = []
    begun, places = list[tuple[MeasuredBoard, _Response]](), list[int]()
    for k, board in enumerate(boards):
        try:
            if isinstance(board, Exception):
                raise board
            begun.append(_begun(board, initial, band))
            places.append(k)
            results.append(begun[-1][0])
        except (EngineError, InputError) as error:
            results.append(error)
    try:
        found: Sequence[MeasuredBoard | Exception] = _measured(
            [board for board, _ in begun], [response for _, response in begun]
        )
    except EngineError:  # one of them: each by itself
        found = [_alone(*each) for each in begun]
    for k, each in zip(places, found, strict=True):
        results[k] = each
    return results


_Response = tuple[ExactResponse, bool] | None  # a step, and whether the outputs return


def _alone(board: MeasuredBoard, response: _Response) -> MeasuredBoard | Exception:
    try:
        return _measured([board], [response])[0]
    except EngineError as error:
        return error


def _begun(board: LinearBoard, initial: Start, band: float) -> tuple[MeasuredBoard, _Response]:
    """Return a board without readings, and the step that has to be read; None if not stable."""
    (found, apart), places = told_apart(board, poles(board)), ends(board, initial)
    if found.known_stable and (doubt := latching(board.circuit)):
        found = replace(found, doubt=doubt)
    before, rest, error = places
    response, returns = step_response(board, initial, band, places)
    if not found.known_stable or apart.beyond:
        still = _without_rest(response, found)
        return MeasuredBoard(board, initial, found, still, before, rest, error, apart), None
    unread_yet = Measurements(response.step.amplitude, band, (), {}, "", ())
    measured = MeasuredBoard(board, initial, found, unread_yet, before, rest, error, apart)
    return measured, (response, returns)


def step_response(
    board: LinearBoard,
    initial: Start,
    band: float,
    places: tuple[Floats, Floats, float] | None = None,
) -> tuple[ExactResponse, bool]:
    """Return the step of the outputs, to be measured, and whether they return to their start.

    `places` are the `ends` of the board, where they are known.
    """
    before, rest, error = places or ends(board, initial)
    start = _pulses(board, before, rest, error, initial)
    return ExactResponse(board, rest, start, initial, band, error), start is not before


def _measured(
    boards: Sequence[MeasuredBoard], responses: Sequence[_Response]
) -> list[MeasuredBoard]:
    wanted = [each for each in responses if each is not None]
    read = iter(measure_responses([response for response, _ in wanted]))
    found = []
    for board, each in zip(boards, responses, strict=True):
        if each is not None:
            measured = next(read)
            board = replace(board, measurements=_settling_alone(measured) if each[1] else measured)
        found.append(board)
    return found


def _without_rest(response: ExactResponse, found: Poles) -> Measurements:
    """Return the measurements of a board that does not come to rest."""
    step, nothing = response.step, unread(len(response.target))
    state = ChannelState.OSCILLATING if found.known_unstable else ChannelState.UNDECIDED
    why = FAR if found.known_stable else UNSTABLE
    still = Settlement(state, None, why)
    channels = [
        channel_measure(n, end, step, nothing, still, None, why)
        for n, end in enumerate(response.target.tolist())
    ]
    return _without(summary(step.amplitude, response.band, (), channels), tuple(READINGS))


def _pulses(
    board: LinearBoard, before: Floats, rest: Floats, error: float, initial: Start
) -> Floats:
    """Return where the outputs start; if all return to there, their largest excursion instead.

    Then an output behind a capacitor settles in shares of this excursion.
    """
    if float(np.abs(rest - before).max(initial=0.0)) > error:
        return before
    solution = exact_solution(board, initial=initial)
    if np.all(solution.poles.real < 0.0):
        size = float(np.abs(solution.flow.share).max(initial=0.0))
        signal = ExactSignal(Course(solution, _signs(board), rest, error, DETAIL * size))
        (high, _), (low, _) = (signal.highest(sign) for sign in (1.0, -1.0))
    else:  # it has no readings, and is compared by the size that it reaches
        seen = np.linspace(0.0, time_scales(board, initial=initial).stop, DRAWN)
        moved = solution.at(seen) * _signs(board) - rest
        high, low = moved.max(axis=0), -moved.min(axis=0)
    peaks = np.where(high >= low, high, -low)
    return rest + peaks if float(np.abs(peaks).max(initial=0.0)) > error else before


def _settling_alone(measured: Measurements) -> Measurements:
    """Return the measurements of outputs without a step, which only settle."""
    channels = [replace(channel, rise_reason=NO_RISE) for channel in measured.channels]
    names = ("rise_time", "overshoot", "undershoot")
    return _without(replace(measured, channels=tuple(channels)), names)


def _without(measured: Measurements, names: Sequence[str]) -> Measurements:
    """Return the measurements without some of the readings."""
    none = dict.fromkeys(names)
    channels = [replace(each, readings={**each.readings, **none}) for each in measured.channels]
    return replace(measured, channels=tuple(channels), readings={**measured.readings, **none})


def ends(board: LinearBoard, initial: Start) -> tuple[Floats, Floats, float]:
    """Return the outputs before the step and at rest, V, and the error of the latter."""
    places = [board.descriptor.place(out.node) for out in board.circuit.outputs]
    signs = _signs(board)
    rest = board.equilibrium.values[places] * signs
    before = board.rest.values[places] * signs if initial == "rest" else np.zeros(len(places))
    return before, rest, float(board.rounding[places].max(initial=0.0))


def _signs(board: LinearBoard) -> Floats:
    return np.array([out.sign for out in board.circuit.outputs])
