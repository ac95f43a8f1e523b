"""Check a deck: what `taction check` says.

A deck is read and linearised (`foreign_board`), measured (`measured_board`), asked (`questions`),
compared with ngspice (`witnesses`) and judged (`board_checks`). Worst cases and the yield are those
of `verification.studies.tolerance`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated

import numpy as np

from taction.netlist_gen.deck.part_tolerances import DeckTolerances
from taction.system.documents import Hertz, Inline, Note, Number, Rate, Steps, Volts
from taction.system.results import Result
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.studies.board_checks import judge
from taction.verification.studies.board_sweep import Sweep, SweptValue, sweep_deck, varied_outcomes
from taction.verification.studies.foreign_board import ForeignBoard
from taction.verification.studies.measured_board import FAR, MeasuredBoard, measure_board
from taction.verification.studies.other_points import points_note, step_note
from taction.verification.studies.part_influence import PartRow, influences
from taction.verification.studies.questions import QUESTIONS, Wanted, units
from taction.verification.studies.tolerance.corners import CornerStudy
from taction.verification.studies.tolerance.montecarlo import YieldReport
from taction.verification.studies.witnesses import compare_ac, compare_transient
from taction.verification.verdict.checks import Check, Outcome, overall, undecided
from taction.verification.verdict.companion import Agreement

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class PoleRow:
    """A pole with its bound."""

    real: Rate
    frequency: Hertz
    damping: Number
    bound: Rate
    hidden: Annotated[bool, Note("no output shows it: it does not decide")]


@dataclass(frozen=True, slots=True)
class OutputRow:
    """An output: rest before and after the step, and the answers of `QUESTIONS` with bounds."""

    name: str
    before: Volts
    rest: Volts
    rest_bound: Volts
    state: str
    figures: Annotated[dict[str, float | None], Inline(units())]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class BoardCheck(MeasuredBoard, Result):
    """All that `taction check` says of a board; `outcome` is that of its checks."""

    VIEW = "taction.verification.report.views.board_check_view:view"
    DOCUMENT = (
        *("name", "outcome", "initial", "notes", "stable = poles.stable"),
        *("poles = pole_rows", "parts", "band = measurements.band", "amplitude [V]", "outputs"),
        *("noise_unknown = noise.unknown", "agreement", "checks", "sweeps", "corners", "yields"),
    )

    notes: tuple[str, ...]
    looked: tuple[PartRow, ...]  # all parts with their margins, where a margin was asked for
    record: Agreement | None
    checks: tuple[Check, ...]
    sweeps: tuple[Sweep, ...]
    corners: CornerStudy | None = None
    yields: YieldReport | None = None

    @property
    def outcome(self) -> Outcome:
        """Of the checks, at the worst corners, too."""
        judged = [overall(self.checks)]
        if self.corners is not None:
            judged.append(Outcome(self.corners.outcome))
        return max(judged, key=_WORSE.index)

    @cached_property
    def parts(self) -> tuple[PartRow, ...]:
        """What each part does to the stability, the most important first."""
        return self.looked or influences(self.board, self.poles)[1]

    @property
    def name(self) -> str:
        """Of the board."""
        return self.circuit.name

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
        for n, out in enumerate(self.circuit.outputs):
            figures = dict[str, float | None]()
            for question, every in answers:
                figures |= question.figures(every[n] if every else None)
            rest = (float(self.before[n]), float(self.rest[n]), self.rest_error)
            rows.append(
                OutputRow(out.node, *rest, self.measurements.channels[n].state.value, figures)
            )
        return tuple(rows)

    @property
    def agreement(self) -> Steps:
        """Largest difference of the two engines over the record, in step amplitudes."""
        if self.record is None or not self.amplitude:
            return None
        return self.record.difference / self.amplitude

    def __repr__(self) -> str:
        said = f"stable: {self.poles.stable}, {len(self.circuit.knobs)} parts"
        return f"BoardCheck({self.name!r}, {self.outcome.value}; {said})"


_WORSE = (Outcome.PASS, Outcome.INCONCLUSIVE, Outcome.FAIL)


def check_board(
    deck: ForeignBoard,
    asked: Wanted,
    *,
    ngspice: bool = True,
    transient: bool = False,
    over: Iterable[SweptValue] = (),
    tolerances: DeckTolerances | None = None,
    samples: tuple[int, int] = (300, 1),
    notes: tuple[str, ...] = (),
    progress: Progress = lambda stage: None,
) -> BoardCheck:
    """Check a deck, as `taction.check` does.

    `samples` are how many boards are drawn, and from which seed; `notes` are said after those of
    the deck.

    EngineError: no equilibrium, or no state-space form.
    """
    progress("poles")
    board, band = LinearBoard(deck.circuit), asked.limits.settling_time.band
    found = measure_board(board, deck.initial, band, asked.lowest)
    margin, rows = None, tuple[PartRow, ...]()
    if asked.margin:
        progress("parts")
        margin, rows = influences(board, found.poles, every=True)
    progress("ngspice")
    record, why, small, left = None, "without ngspice", None, [""]
    moves = transient or deck.has_transient or "engines_agree" in asked.names
    if ngspice and deck.point is None and moves:
        why = f"ngspice's transient was not compared: {FAR}"
        if not found.apart.beyond:
            limit = asked.limits.engines_agree.tolerance
            record, why = compare_transient(found, deck.witness, limit)
    elif ngspice:
        why, every = "", np.append(found.poles.poles, found.apart.hidden)
        small = compare_ac(deck.at_rest, board, every)
    if ngspice and deck.point is not None:
        left = [points_note(found, deck.point)]
        if any(each.moves for each in deck.flat.stimuli.values()):
            left.append(step_note(found, deck.point))
    checks = list(judge(found, asked, margin, record))
    if record is None and "engines_agree" in asked.names:
        checks.append(undecided("engines_agree", "step", why, asked.limits.engines_agree.limit))
    checks += [] if small is None else [small]
    progress("sweeps")
    sweeps = tuple(sweep_deck(deck, board, each, band) for each in over)
    corners, yields = None, None
    if tolerances is not None:
        corners, yields = varied_outcomes(found, deck, tolerances, asked, samples, progress)
    made = BoardCheck(
        **{each.name: getattr(found, each.name) for each in fields(found)},
        notes=tuple(filter(None, (*found.apart.sentences, *deck.notes, *notes, why, *left))),
        looked=rows,
        record=record,
        checks=tuple(checks),
        sweeps=sweeps,
        corners=corners,
        yields=yields,
    )
    vars(made).update(vars(found))  # with what it has computed
    return made
