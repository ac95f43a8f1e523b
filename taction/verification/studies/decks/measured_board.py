"""A board without a scene as the state-space engine sees it: poles, readings, noise, its record.

Without a reference solution the outputs are compared with their own equilibrium.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.check_keys import LOWEST
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.reading_definitions import READINGS
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.readings.exact_measures import ExactResponse, ExactTrace
from taction.verification.readings.measurements import Measurements, channel_measure, summary
from taction.verification.readings.readings import unread
from taction.verification.readings.settling import ChannelState, Settlement
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import Poles, poles
from taction.verification.stability.shown_poles import PolesApart, latching, told_apart
from taction.verification.studies.decks.part_influence import PartRow, influences, least_margin
from taction.verification.verdict.board import OutputNoise

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
    """A linear board, its poles, and the step of its outputs against their own equilibrium."""

    board: LinearBoard
    initial: Start  # whether the step begins at rest, or with no charge
    poles: Poles
    measurements: Measurements
    before: Floats  # (N,): outputs before the step, V
    rest: Floats  # (N,): and at rest, V
    rest_error: float  # bound on the error of `rest`, V
    apart: PolesApart = field(default_factory=PolesApart)  # poles that do not decide
    # Lowest frequency of the noise, Hz; None: that of the op-amps.
    lowest: float | None = None
    every: bool = False  # whether the margins of all parts are wanted

    @property
    def circuit(self) -> Circuit:
        """The board."""
        return self.board.circuit

    @cached_property
    def scales(self) -> TimeScales:
        """The time scales of its modes."""
        return time_scales(self.board, initial=self.initial)

    @cached_property
    def noise(self) -> OutputNoise:
        """The noise of its outputs; or why it is not known.

        Where one output has none, the others are known by themselves, and this one is NaN.
        """
        if not self.poles.known_stable:
            return OutputNoise(unknown="only a board that is known to be stable has noise at rest")
        if self.apart.beyond:
            return OutputNoise(unknown=FAR)
        circuit = self.board.circuit
        flicker = any(model.flicker_noise > 0.0 for model in circuit.models.values())
        low = self.lowest or (LOWEST if flicker else 0.0)
        try:
            rms, error = output_noise(self.board, low)
            return OutputNoise(tuple(rms.tolist()), tuple(error.tolist()), lowest=low)
        except EngineError as problem:
            if len(circuit.outputs) == 1:
                return OutputNoise(unknown=str(problem))
        count, reasons = len(circuit.outputs), dict[str, list[str]]()
        rms, error = np.full(count, math.nan), np.full(count, math.nan)
        for k, out in enumerate(circuit.outputs):
            try:
                alone = LinearBoard(replace(circuit, outputs=(out,)))
                rms[k : k + 1], error[k : k + 1] = output_noise(alone, low)
            except EngineError as problem:
                why = str(problem).replace(f" of output {out.node}", "")
                reasons.setdefault(why, []).append(out.node)
        said = "; ".join(f"{', '.join(nodes)}: {why}" for why, nodes in reasons.items())
        return OutputNoise(tuple(rms.tolist()), tuple(error.tolist()), unknown=said, lowest=low)

    @cached_property
    def parts(self) -> tuple[PartRow, ...]:
        """What each part does to the stability, the most important first."""
        return influences(self.board, self.poles, every=self.every)

    @property
    def margin(self) -> Margin:
        """The least margin of any part, where `every` one is known."""
        return least_margin(self.board, self.poles, self.parts)

    @property
    def remedy(self) -> str:
        """What to look at where the board is not stable."""
        hint = OSCILLATOR if self.poles.rightmost.imag else LATCH
        return f"no node that you look at shows it; {hint}" if self.apart.unseen else hint

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


def measure_board(
    board: LinearBoard,
    initial: Start,
    band: float,
    lowest: float | None = None,
    *,
    every: bool = False,
) -> MeasuredBoard:
    """Return one measured board; `band` is that of the settling time.

    EngineError: no equilibrium, no state-space form, or no exact solution.
    """
    found, apart = told_apart(board, poles(board))
    if found.known_stable and (doubt := latching(board.circuit)):
        found = replace(found, doubt=doubt)
    step, before = step_response(board, initial, band), ends(board, initial)[0]
    rests = found.known_stable and not apart.beyond
    measured = step.measured() if rests else _without_rest(step, found)
    if rests and not np.array_equal(np.asarray(step.start), before):  # they only settle
        channels = [replace(channel, rise_reason=NO_RISE) for channel in measured.channels]
        measured = replace(measured, channels=tuple(channels))
        measured = _without(measured, ("rise_time", "overshoot", "undershoot"))
    rest, error = step.target, step.target_error
    known = board, initial, found, measured, before, rest, error, apart
    return MeasuredBoard(*known, lowest, every)


def step_response(board: LinearBoard, initial: Start, band: float) -> ExactResponse:
    """Return the step of the outputs, to be measured.

    Outputs that all return to their start begin at their largest excursion instead: then one behind
    a capacitor settles in shares of it.
    """
    before, rest, error = ends(board, initial)
    start = before
    if float(np.abs(rest - before).max(initial=0.0)) <= error:
        peaks = _peaks(board, rest, error, initial)
        start = rest + peaks if float(np.abs(peaks).max(initial=0.0)) > error else before
    return ExactResponse(board, rest, start, initial, band, error)


def _without_rest(response: ExactResponse, found: Poles) -> Measurements:
    """Return the measurements of a board that does not come to rest."""
    step, nothing = response.step, unread(len(response.target))
    state = ChannelState.OSCILLATING if found.known_unstable else ChannelState.UNDECIDED
    why = FAR if found.known_stable else UNSTABLE
    still = Settlement(state, None, why)
    channels = [
        channel_measure(n, end, step, nothing, still, (), why)
        for n, end in enumerate(response.target.tolist())
    ]
    return _without(summary(step.amplitude, response.band, (), channels), tuple(READINGS))


def _peaks(board: LinearBoard, rest: Floats, error: float, initial: Start) -> Floats:
    """Return the largest excursions of the outputs from their rest, V, with their signs."""
    solution = exact_solution(board, initial=initial)
    if np.all(solution.poles.real < 0.0):
        size = float(np.abs(solution.flow.share).max(initial=0.0))
        trace = ExactTrace(solution, _signs(board), rest, error, DETAIL * size)
        (high, _), (low, _) = (trace.highest(sign) for sign in (1.0, -1.0))
    else:  # it has no readings, and is compared by the size that it reaches
        seen = np.linspace(0.0, time_scales(board, initial=initial).stop, DRAWN)
        moved = solution.at(seen) * _signs(board) - rest
        high, low = moved.max(axis=0), -moved.min(axis=0)
    return np.asarray(np.where(high >= low, high, -low))


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
