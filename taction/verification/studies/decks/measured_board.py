"""A board without a scene as the state-space engine sees it: poles, readings, noise, its parts.

Without a reference solution the outputs are compared with their own equilibrium. What each part
does to the stability are the sensitivity of the rightmost pole, and margins both ways.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.check_keys import LOWEST
from taction.system.array_types import Floats
from taction.system.documents import HIDDEN, Hertz, Number, Rate
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.system.reading_definitions import READINGS
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.readings.exact_measures import ExactResponse, ExactTrace
from taction.verification.readings.measurements import Measurements, channel_measure, summary
from taction.verification.readings.readings import unread
from taction.verification.readings.settling import ChannelState, Settlement
from taction.verification.stability.edges import Edge
from taction.verification.stability.families import Family, find_edges, sensitivities
from taction.verification.stability.margin import REACH, Margin
from taction.verification.stability.poles import Poles, poles
from taction.verification.stability.shown_poles import BAND, PolesApart, latching, told_apart
from taction.verification.verdict.board import OutputNoise

WANTED = 1e-4  # error of ngspice's transient, in step amplitudes
DETAIL = 1e-3  # of the largest mode: one that the first grid resolves
DRAWN = 1000  # instants of a drawn response, early and late
EARLIEST = 1e-4  # of a drawn response: its first instant after 0
NO_RISE = "the output returns to where it was: it has no step"
UNSTABLE = "the board is not stable"
LOST_END = "rounding hides how its transient ends"
FAR = "the model itself grows beyond the band of 10 GHz"
OSCILLATOR = "for an oscillator: --check oscillates"
LATCH = "positive feedback makes it latch, as exchanged inputs of an op-amp do"
Start = Literal["zero", "rest"]
MOST_MARGINS = 12  # parts whose margins are found unless a margin is checked
MOST_WORK = 3e6  # these parts times the cube of the unknowns, likewise
MORE = 1.001  # of the largest factor: an edge at it is found with certainty
UNKNOWN = "not looked for"


@dataclass(frozen=True, slots=True)
class PartRow:
    """A part: what it does to the rightmost pole, and where the board becomes unstable."""

    name: str
    value: Number
    unit: str
    real: Rate  # d Re p / d ln value
    frequency: Hertz  # d f / d ln value
    # The nearest values with a pole on the imaginary axis, within a factor of 100; of a board that
    # is not stable those with which it is.
    below: Number = None
    above: Number = None
    doubt: str = ""  # why they are not known
    # These over the factor of the value; the factor up to which is no other in spite of a doubt.
    edges: Annotated[tuple[Edge, ...], HIDDEN] = ()
    sure: Annotated[float, HIDDEN] = math.inf


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
        """What each part does to the stability, the most important first.

        Unless `every` part is to be looked at, the edges of a stable board are those of the
        `MOST_MARGINS` parts that move the rightmost pole most, and of a large board those of fewer
        (`MOST_WORK`).
        """
        board, found, c, every = self.board, self.poles, self.circuit, self.every
        knobs = [knob for knob in c.knobs if knob.role]
        families = dict(zip([k.name for k in knobs], Family.of_each(board, knobs), strict=True))
        rates = sensitivities(board, found, families)
        order = sorted(rates, key=lambda name: -abs(rates[name].real))
        most = len(order) if every or found.known_unstable else MOST_MARGINS
        if not every:
            most = min(most, int(MOST_WORK / board.descriptor.size**3))
        if found.stable is None or board.state_space.lost:
            most = 0
        rows = list[PartRow]()
        for k, name in enumerate(order):
            edges, doubt, sure = _nearest(families[name], found) if k < most else ((), UNKNOWN, 1.0)
            own, unit, rate = c.value(name), c.facts[name].unit, rates[name]
            known = rate.real, rate.imag / math.tau, *beside(own, edges)
            rows.append(PartRow(name, own, unit, *known, doubt, edges, sure))
        return tuple(rows)

    @property
    def margin(self) -> Margin:
        """The least margin of any part, where `every` one is known."""
        c, rows = self.circuit, self.parts
        if not self.poles.known_stable:
            return Margin(0.0, 0.0, "the board is not stable")
        if not len(self.poles.poles):
            gains = c.opamps or any(part.control for part in c.branches)
            active = gains or any(part.ohms <= 0.0 for part in c.resistors)
            doubt = "a source with gain may have another sign of its feedback" * bool(active)
            return Margin(REACH, 0.0, "no part makes a pole", doubt)
        if not rows:
            return Margin(1.0, 0.0, "no margin is known", "the board is too large")
        factor, bound, text = REACH, 0.0, f"no crossing up to a factor of {REACH:g} of any part"
        for row, edge in ((each, edge) for each in rows for edge in each.edges):
            if (by := max(edge.value, 1.0 / edge.value)) < factor:
                factor, bound = by, edge.bound * by / edge.value
                moves = "grow" if edge.value > 1.0 else "shrink"
                end = show(c.value(row.name) * edge.value, row.unit)
                text = f"{c.knob(row.name).words} can {moves} by the factor {by:.4g}, to {end}"
        doubts = (f"{row.name}: {row.doubt}" for row in rows if row.doubt and row.sure <= factor)
        return Margin(factor, bound, text, next(doubts, ""))

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
    why = UNSTABLE if not found.known_stable else FAR if apart.beyond else ""
    try:
        measured = _without_rest(step, found, why) if why else step.measured()
    except EngineError:
        why, measured = LOST_END, _without_rest(step, found, LOST_END)
    if not why and not np.array_equal(np.asarray(step.start), before):  # they only settle
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


def _without_rest(response: ExactResponse, found: Poles, why: str) -> Measurements:
    """Return the measurements of a board that does not come to rest."""
    step, nothing = response.step, unread(len(response.target))
    state = ChannelState.OSCILLATING if found.known_unstable else ChannelState.UNDECIDED
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


def beside(own: float, edges: Iterable[Edge]) -> tuple[Number, Number]:
    """Return the value at the edge below `own`, and at that above."""
    ends = [own * edge.value for edge in edges]
    return next((v for v in ends if v < own), None), next((v for v in ends if v > own), None)


def _nearest(family: Family, found: Poles) -> tuple[tuple[Edge, ...], str, float]:
    """Return the nearest edges over the factor of a value, which keeps its sign; of 0 none.

    Then a doubt, and the factor up to which is none. Of a board that is not stable the edges are
    the nearest ends of ranges in which it is.
    """
    reach, stable = REACH * MORE, found.known_stable
    if not family.own:
        return (), "", math.inf
    over = replace(family, board=lambda factor: family.board(family.own * factor), own=1.0)
    try:
        edges = find_edges(over, 1.0 / reach, reach, found)
    except EngineError as error:
        return (), str(error), 1.0
    seen = [edge for edge in edges.edges if edge.frequency <= BAND]  # no pole of a model beyond
    every = [edge for edge in seen if stable or edge.changes_stability]
    below = max((e for e in every if e.value < 1.0), key=lambda e: e.value, default=None)
    above = min((e for e in every if e.value > 1.0), key=lambda e: e.value, default=None)
    low, high = below.value if below else 0.0, above.value if above else math.inf
    near = [max(factor, 1.0 / factor) for factor in edges.near if low <= factor <= high]
    doubt = "a pole comes close to the axis" if near else ""
    return tuple(filter(None, (below, above))), doubt, min(near, default=math.inf)
