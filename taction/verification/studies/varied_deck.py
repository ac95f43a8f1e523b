"""A board without a scene whose parts and parameters vary: its samples, worst corners and yield.

Corners and Monte Carlo are those of scenes (`verification.studies.tolerance`). The outputs at rest
are compared with those of the nominal board.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import Parameter, parameters, vary
from taction.netlist_gen.deck.part_tolerances import DeckTolerances
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.studies.board_checks import judge, record_of
from taction.verification.studies.foreign_board import ForeignBoard
from taction.verification.studies.measured_board import MeasuredBoard, measure_boards
from taction.verification.studies.part_influence import influences
from taction.verification.studies.questions import QUESTIONS, Wanted
from taction.verification.studies.running.pool import HERE
from taction.verification.studies.running.study import Pace
from taction.verification.studies.running.versions import own_version
from taction.verification.studies.tolerance.corners import CornerStudy, worst_of
from taction.verification.studies.tolerance.drawing import SampleCollection, run_samples
from taction.verification.studies.tolerance.samples import BoardSample, Quantity, Varied
from taction.verification.studies.tolerance.yield_report import YieldReport, summarise_samples

PARAM = "param"  # kind of a parameter


@dataclass(frozen=True, eq=False)
class VariedDeck(Varied):
    """The nominal board of a deck, its varied parts, and what is asked of its samples."""

    params: Mapping[str, float]  # nominal values of the .param that vary; last in `varied`
    deck: ForeignBoard
    asked: Wanted

    @classmethod
    def of(
        cls, found: MeasuredBoard, deck: ForeignBoard, spread: DeckTolerances, asked: Wanted
    ) -> VariedDeck:
        """Return the boards around a measured one; a ``.param`` that varies is not 0."""
        params = dict[str, float]()
        for name in spread.params:
            value = deck.value_of(name)
            if not value:
                text = "a tolerance needs a .param whose value is a number other than 0"
                raise InputError("--tolerances", Complaint(f"params.{name}", f"{value}", text))
            params[name] = value
        varied = (
            *parameters(found.circuit, spread.parts),
            *(Parameter(name, PARAM, share) for name, share in spread.params.items()),
        )
        return cls(
            name=found.circuit.name,
            engine="statespace",
            nominal=found.circuit,
            varied=varied,
            tolerances=spread.parts,
            quantities=tuple(_quantities(asked)),
            target=found.rest,
            step_amplitude=found.amplitude or float(np.abs(found.rest).max(initial=0.0)) or 1.0,
            version=own_version(False),
            params=params,
            deck=deck,
            asked=asked,
        )

    def at(self, z: Floats) -> Circuit:
        """Return the board with deviations `z`."""
        (found,) = self._built([z])
        if isinstance(found, InputError):
            raise found
        return found

    def _built(self, each: Sequence[Floats]) -> Iterator[Circuit | InputError]:
        """Yield boards with deviations; those of parameters are expanded by one run of ngspice."""
        count = len(self.varied) - len(self.params)
        nominal: Sequence[Circuit | InputError] = [self.nominal] * len(each)
        if self.params:
            nominal = self.deck.at([self._values(z[count:]) for z in each])
        for board, z in zip(nominal, each, strict=True):
            try:
                if isinstance(board, InputError):
                    raise board
                yield vary(board, self.tolerances, z[:count])
            except InputError as error:
                yield error

    def _values(self, z: Floats) -> dict[str, float]:
        """Return the values of the parameters with their deviations."""
        shares = (math.log1p(p.tolerance) for p in self.varied[len(self.varied) - len(z) :])
        every = zip(self.params.items(), z.tolist(), shares, strict=True)
        return {name: own * math.exp(off * share) for (name, own), off, share in every}

    def measured(self, number: int, z: Floats) -> BoardSample:
        """Return the sample with deviations `z`; `EngineError` where it cannot be measured."""
        (found,) = self._measured([(number, z)])
        if isinstance(found, Exception):
            raise found
        return found

    def measured_together(self, requests: Sequence[tuple[int, Floats]]) -> list[BoardSample | None]:
        """Return several samples, None for each one that has an error."""
        return [None if isinstance(each, Exception) else each for each in self._measured(requests)]

    def _measured(
        self, requests: Sequence[tuple[int, Floats]]
    ) -> Iterator[BoardSample | Exception]:
        circuits = self._built([z for _, z in requests])
        boards = (c if isinstance(c, InputError) else LinearBoard(c) for c in circuits)
        band = self.asked.limits.settling_time.band
        measured = measure_boards(boards, self.deck.initial, band, self.asked.lowest)
        for (number, _), found in zip(requests, measured, strict=True):
            yield self._sample(number, found) if isinstance(found, MeasuredBoard) else found

    def _sample(self, number: int, found: MeasuredBoard) -> BoardSample:
        """Return the sample of a measured board."""
        margin = None
        if self.asked.margin:
            margin, _ = influences(found.board, found.poles, every=True)
        record = record_of(found, judge(found, self.asked, margin), self.asked, margin)
        errors = (found.rest - self.target) / self.step_amplitude
        figures: dict[str, float | None] = dict(record.figures)
        figures["steady_state_error"] = float(np.abs(errors).max(initial=0.0))
        record = replace(record, figures=figures, channels=())
        return BoardSample(number, record, tuple(errors.tolist()))


def _quantities(asked: Wanted) -> Iterator[Quantity]:
    """Yield the questions with their limits, how far a board rests from the nominal one, and poles.

    Poles: the growth rate, and the margin where it is asked for.
    """
    for question in QUESTIONS.values():
        if question.over or question.name in asked.names:
            limits = asked.tables.get(question.name) and getattr(asked.limits, question.name)
            limit = asked.own.get(question.name, getattr(limits, "max", None))
            band = asked.limits.settling_time.band if question.second == "band" else None
            worse, name, unit = -1.0 if question.large else 1.0, question.name, question.unit
            least, most = (limit, None) if question.large else (None, limit)
            yield Quantity(name, unit, worse, least, most, band)
    yield Quantity("steady_state", "step")
    if asked.oscillates:
        yield Quantity("growth_rate", "1/s", -1.0, at_least=0.0)
    else:
        yield Quantity("growth_rate", "1/s", at_most=0.0)
    if asked.margin:
        yield Quantity("margin", "ratio", -1.0, at_least=asked.limits.stability.margin)


def varied_outcomes(
    found: MeasuredBoard,
    deck: ForeignBoard,
    spread: DeckTolerances,
    asked: Wanted,
    samples: tuple[int, int],
    progress: Callable[[str], None] = lambda stage: None,
) -> tuple[CornerStudy, YieldReport]:
    """Return the worst corners of a board within its tolerances, and the yield of its samples.

    `samples` are how many boards are drawn, and from which seed.
    """
    count, seed = samples
    board, tally, pace = VariedDeck.of(found, deck, spread, asked), SampleCollection(count), Pace()
    corners = worst_of(board, HERE, progress)
    for _ in run_samples(board, range(count), seed, HERE, tally):
        left = pace.ended(count - len(tally.samples))
        progress(f"yield: {len(tally.samples)} of {count} samples{left}")
    return corners, summarise_samples(board, tally.samples, seed)
