"""Check a deck: what `taction check` says.

A deck is read and linearised (`foreign_board`), measured (`measured_board`), asked and judged
(`questions`), and compared with ngspice (`witnesses`). Two things an operating point leaves open:
latches have several, and ngspice may find the one that no board keeps; and a large step leaves the
range in which the circuit is linear.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from taction.netlist_gen.scene.axes import SweepAxis
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.system.documents import Hertz, Number, Rate, Volts, taken
from taction.system.progress import Progress
from taction.system.quantities import show
from taction.system.results import Result
from taction.verification.characterise.operating_point import AT_ONCE, UNBIASED, DeckPoint
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.families import pole_vectors
from taction.verification.studies.decks.board_sweep import Sweep, VariedDeck, sweep_deck
from taction.verification.studies.decks.foreign_board import ForeignBoard
from taction.verification.studies.decks.measured_board import MeasuredBoard, measure_board
from taction.verification.studies.decks.questions import QUESTIONS, Wanted, judge, units
from taction.verification.studies.decks.witnesses import compare_ac, compare_transient, stepping
from taction.verification.studies.running.study import HERE
from taction.verification.studies.tolerance.corners import CornerStudy, worst_of
from taction.verification.studies.tolerance.montecarlo import (
    BoardSample,
    YieldReport,
    run_samples,
    summarise_samples,
)
from taction.verification.verdict.checks import SEVERITY, Check, Outcome, overall


@dataclass(frozen=True, slots=True)
class PoleRow:
    """A pole with its bound."""

    real: Rate
    frequency: Hertz
    damping: Number
    bound: Rate
    hidden: Annotated[bool, {"note": "no output shows it: it does not decide"}]


@dataclass(frozen=True, slots=True)
class OutputRow:
    """An output: rest before and after the step, and the answers of `QUESTIONS` with bounds."""

    name: str
    before: Volts
    rest: Volts
    rest_bound: Volts
    state: str
    figures: Annotated[dict[str, float | None], {"inline": units()}]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class BoardCheck(MeasuredBoard, Result):
    """All that `taction check` says of a board; `outcome` is that of its checks."""

    VIEW = "taction.verification.report.views.board_check_view:view"
    DOCUMENT = (
        *("name = circuit.name", "outcome", "initial", "notes", "stable = poles.stable"),
        *("poles = pole_rows", "parts", "band = measurements.band"),
        *("amplitude [V] = measurements.amplitude", "outputs"),
        *("noise_unknown = noise.unknown", "checks", "sweeps", "corners", "yields"),
    )

    notes: tuple[str, ...]
    checks: tuple[Check, ...]
    sweeps: tuple[Sweep, ...]
    corners: CornerStudy | None = None
    yields: YieldReport | None = None

    @property
    def outcome(self) -> Outcome:
        """Of the checks, at the worst corners, too."""
        corners = [] if self.corners is None else [Outcome(self.corners.outcome)]
        return max([overall(self.checks), *corners], key=SEVERITY.index)

    @property
    def pole_rows(self) -> tuple[PoleRow, ...]:
        """Poles with Im >= 0, rightmost first; those that no output shows come last."""
        return tuple(
            PoleRow(p.real, p.imag / math.tau, -p.real / abs(p) if p else 0.0, bound, hidden)
            for values, errors, hidden in (
                (self.poles.poles, self.poles.errors, False),
                (self.apart.hidden, self.apart.hidden_errors, True),
            )
            for p, bound in zip(values.tolist(), errors.tolist(), strict=True)
            if p.imag >= 0.0
        )

    @cached_property
    def outputs(self) -> tuple[OutputRow, ...]:
        """The outputs with their answers."""
        answers = [(each, each.answer(self)) for each in QUESTIONS.values()]
        rows = list[OutputRow]()
        for n, channel in enumerate(self.measurements.channels):
            figures = dict[str, float | None]()
            for question, every in answers:
                figures |= question.figures(every[n] if every else None)
            name, before, rest = self.circuit.outputs[n].node, self.before[n], self.rest[n]
            known = (name, float(before), float(rest), self.rest_error, channel.state.value)
            rows.append(OutputRow(*known, figures))
        return tuple(rows)


def check_board(
    deck: ForeignBoard,
    asked: Wanted,
    *,
    ngspice: bool = True,
    transient: bool = False,
    over: Iterable[SweepAxis] = (),
    tolerances: Tolerances | None = None,
    samples: tuple[int, int] = (300, 1),
    progress: Progress = lambda stage: None,
) -> BoardCheck:
    """Check a deck, as `taction.check` does.

    `samples` are how many boards are drawn, and from which seed.
    """
    progress("poles")
    board, band = LinearBoard(deck.circuit), asked.limits.settling_time.band
    found = measure_board(board, deck.initial, band, asked.lowest, every=asked.margin)
    if asked.margin:
        progress("parts")
    checks, why = [*judge(found, asked)], ["" if ngspice else "without ngspice"]
    progress("ngspice")
    if ngspice:
        every = np.append(found.poles.poles, found.apart.hidden)
        checks.append(compare_ac(deck.point, board, every, deck.flat.absent))
    if transient or "engines_agree" in asked.names:
        limit = asked.limits.engines_agree.limit
        checks.append(compare_transient(found, deck, limit, ngspice=ngspice))
    if ngspice and not deck.is_linear:
        why.append(points_note(found, deck.point))
        if any(each.step for each in deck.point.flat.sources):
            why.append(step_note(found, deck.point))
    progress("sweeps")
    sweeps = tuple(sweep_deck(deck, board, each, band) for each in over)
    corners = yields = None
    if tolerances is not None:
        varied, drawn = VariedDeck.of(found, deck, tolerances, asked), list[BoardSample]()
        corners = worst_of(varied, HERE, progress)
        for sample in run_samples(varied, *samples, HERE):
            drawn.append(sample)
            progress(f"yield: {len(drawn)} of {samples[0]} samples")
        yields = summarise_samples(varied, drawn, samples[1])
    made = taken(
        BoardCheck,
        found,
        notes=tuple(filter(None, (*found.apart.sentences, *deck.notes, *why))),
        checks=tuple(checks),
        sweeps=sweeps,
        corners=corners,
        yields=yields,
    )
    vars(made).update(vars(found))  # with what it has computed
    return made


STARTS = 12  # along the growing mode, then drawn
# of the range of all voltages
REACHES = [sign * size for size in (0.05, 0.15, 0.4, 1.0, 10.0) for sign in (1.0, -1.0)]
WIDER = 2.0  # times the range of all voltages on either side: drawn ones
SAME = 1e-3  # of this range, or of a voltage: a smaller distance is the same point
ALL_SECONDS = 8.0  # of all starts: no further one begins later
TINY = 1e-30  # V: of no step at all
LARGE = 0.01  # of the step, or of a node's own: how far ngspice's rest may be from the linear one


def points_note(found: MeasuredBoard, point: DeckPoint) -> str:
    """Return how many operating points ngspice finds from other starts; empty for this one.

    One start has every voltage at the other end of their range; of an unstable point there are
    more, along the growing mode and drawn.
    """
    poles = found.poles
    growing = (poles.poles.imag == 0.0) & (poles.poles.real > poles.errors)
    unstable = bool(np.any(growing))
    nodes = [name for name in found.board.descriptor.names if name in point.volts]
    here = np.array([point.volts[name] for name in nodes])
    low, high = here.min(), here.max()
    span = float(high - low) if high - low > UNBIASED else 1.0
    starts = (low + high - here)[None]
    if unstable:
        low, high = low - WIDER * span, high + WIDER * span
        drawn = np.random.default_rng(5).uniform(low, high, (STARTS - len(REACHES), len(here)))
        mode = pole_vectors(found.board, complex(poles.poles[growing][0]))[0].real
        mode = mode[[found.board.descriptor.place(name) for name in nodes]]
        starts = np.vstack([here + span * np.outer(REACHES, mode / np.abs(mode).max()), drawn])
    known, tried, end = [here], 0, time.monotonic() + ALL_SECONDS
    lines = [*point.lines, f".options reltol=1e-6 abstol=1e-13 vntol=1e-10 {point.options}"]
    while tried < len(starts) and time.monotonic() < end:
        start, tried = zip(nodes, starts[tried].tolist(), strict=True), tried + 1
        volts = point.rest([*lines, *(f".nodeset v({n})={v!r}" for n, v in start)], AT_ONCE)
        there = np.array([volts.get(name, np.nan) for name in nodes])
        if volts and all(np.abs(there - each).max() > SAME * span for each in known):
            known.append(there)
    if len(known) == 1:
        text = f"from {tried} other starts ngspice finds no operating point but this unstable one"
        return text if unstable else ""
    moved, out = np.abs(known - here).max(axis=0), found.board.circuit.outputs[0].node
    seen = out in nodes and moved[nodes.index(out)] > SAME * span
    at = nodes.index(out) if seen else int(moved.argmax())
    own, *others = (show(float(each[at]), "V", 4) for each in known)
    return (
        f"at least {len(known)} operating points: all that follows is of this one,"
        f"{' which is unstable,' * unstable} with v({nodes[at]}) = {own}; the others have"
        f" {', '.join(others)}"
    )


def step_note(found: MeasuredBoard, point: DeckPoint) -> str:
    """Return that a step leaves the range in which a deck is linear; empty where it does not."""
    if not found.poles.known_stable:
        return ""
    alter = (f"alter {name} dc={s.value!r}" for name, s in stepping(found.board).items())
    text = [*point.lines, f".options reltol=1e-6 {point.options}", *point.starts]
    volts = point.rest(text, *alter)
    if not volts:
        return "ngspice finds no operating point after the step: readings hold for small steps only"
    values, places = found.board.equilibrium.values, found.board.descriptor.places
    step = max(found.measurements.amplitude, TINY)
    off, name, linear, true = max(
        (max(abs(values[places[n]] - v) - SAME * abs(v), 0.0) / max(step, abs(v - point.volts[n])),
         n, float(values[places[n]]), v)
        for n, v in volts.items()
        if n in places and n in point.volts
    )  # fmt: skip
    if off <= LARGE:
        return ""
    return (
        f"the step is too large for small signals: after it ngspice's operating point has v({name})"
        f" = {show(true, 'V', 4)}, the linear circuit {show(linear, 'V', 4)}; readings of the step"
        " hold for small steps only"
    )
