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
from taction.verification.studies.measured_board import MeasuredBoard, Start, measure_boards
from taction.verification.studies.part_influence import influences
from taction.verification.studies.questions import QUESTIONS, Question
from taction.verification.studies.running.collecting import Pace
from taction.verification.studies.running.executors import in_this_process
from taction.verification.studies.running.versions import own_version
from taction.verification.studies.tolerance.corners import CornerStudy, worst_of
from taction.verification.studies.tolerance.drawing import SampleCollection, run_samples
from taction.verification.studies.tolerance.samples import BoardSample, Quantity, Varied
from taction.verification.studies.tolerance.yield_report import YieldReport, summarise_samples
from taction.verification.studies.wanted_checks import Wanted

PARAM = "param"  # kind of a parameter


@dataclass(frozen=True, eq=False)
class VariedDeck(Varied):
    """The nominal board of a deck, its varied parts, and what is asked of its samples."""

    params: Mapping[str, float]  # nominal values of the .param that vary; last in `varied`
    deck: ForeignBoard
    asked: Wanted
    initial: Start

    @classmethod
    def of(
        cls, found: MeasuredBoard, deck: ForeignBoard, spread: DeckTolerances, asked: Wanted
    ) -> VariedDeck:
        """Return the boards around a measured one.

        Raises
        ------
        InputError
            A ``.param`` that varies is no number other than 0.
        """
        largest = float(np.abs(found.rest).max(initial=0.0))
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
            step_amplitude=found.amplitude or largest or 1.0,
            version=own_version(False),
            params=params,
            deck=deck,
            asked=asked,
            initial=found.initial,
        )

    def by_statespace(self) -> VariedDeck:
        """Return itself."""
        return self

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
        shares = (p.tolerance for p in self.varied[len(self.varied) - len(z) :])
        return {
            name: own * math.exp(off * math.log1p(share))
            for (name, own), off, share in zip(self.params.items(), z.tolist(), shares, strict=True)
        }

    def measured(self, number: int, z: Floats) -> BoardSample:
        """Return the sample with deviations `z`.

        Raises
        ------
        EngineError
            No equilibrium, no state-space form, or no exact solution.
        """
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
        for (number, _), found in zip(
            requests, measure_boards(boards, self.initial, band, self.asked.lowest), strict=True
        ):
            yield self._sample(number, found) if isinstance(found, MeasuredBoard) else found

    def _sample(self, number: int, found: MeasuredBoard) -> BoardSample:
        """Return the sample of a measured board."""
        margin = None
        if self.asked.limits.stability.margin > 1.0:
            margin, _ = influences(found.board, found.poles, every=True)
        record = record_of(found, judge(found, self.asked, margin), self.asked, margin)
        errors = (found.rest - self.target) / self.step_amplitude
        figures: dict[str, float | None] = dict(record.figures)
        figures["steady_state_error"] = float(np.abs(errors).max(initial=0.0))
        record = replace(record, figures=figures, channels=())
        return BoardSample(number, record, tuple(errors.tolist()))


def _quantities(asked: Wanted) -> Iterator[Quantity]:
    """Yield the readings, how far a board rests from the nominal one, growth rate and margin."""
    for each in QUESTIONS.values():
        if each.over or each.name in asked.names:
            yield _quantity(asked, each)
    yield Quantity("steady_state", "step")
    if asked.oscillates:
        yield Quantity("growth_rate", "1/s", -1.0, at_least=0.0)
    else:
        yield Quantity("growth_rate", "1/s", at_most=0.0)
    if asked.limits.stability.margin > 1.0:
        yield Quantity("margin", "ratio", -1.0, at_least=asked.limits.stability.margin)


def _quantity(asked: Wanted, question: Question) -> Quantity:
    """Return a question as a quantity with its limit."""
    limits = getattr(asked.limits, question.name, None)
    limit = getattr(limits, "max", None) if question.name in asked.names else None
    limit = asked.own.get(question.name, limit)
    least, most = (limit, None) if question.large else (None, limit)
    band = asked.limits.settling_time.band if question.second == "band" else None
    worse = -1.0 if question.large else 1.0
    return Quantity(question.name, question.unit, worse, least, most, band)


def varied_outcomes(
    found: MeasuredBoard,
    deck: ForeignBoard,
    spread: DeckTolerances,
    asked: Wanted,
    samples: tuple[int, int],
    progress: Callable[[str], None] = lambda stage: None,
) -> tuple[CornerStudy, YieldReport]:
    """Return the worst corners of a board within its tolerances, and the yield of its samples.

    Parameters
    ----------
    samples : (int, int)
        How many boards are drawn, and from which seed.

    Raises
    ------
    InputError
        A ``.param`` that varies is no number other than 0.
    EngineError
        The nominal board, or one at a corner, has no equilibrium.
    """
    count, seed = samples
    board, tally, pace = VariedDeck.of(found, deck, spread, asked), SampleCollection(count), Pace()
    with in_this_process() as workers:
        corners = worst_of(board, workers, progress)
        for _ in run_samples(board, range(count), seed, workers, tally):
            left = pace.ended(count - len(tally.samples))
            progress(f"yield: {len(tally.samples)} of {count} samples{left}")
    return corners, summarise_samples(board, tally.samples, seed)
