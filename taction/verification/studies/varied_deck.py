"""A board without a scene whose parts and parameters vary: its samples, worst corners and yield.

Corners and Monte Carlo are those of scenes (`verification.studies.tolerance`). The outputs at rest
are compared with those of the nominal board.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import Parameter, parameters, vary
from taction.netlist_gen.deck.part_tolerances import DeckTolerances
from taction.netlist_gen.scene.checks import Tolerances
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.reading_definitions import READINGS
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.studies.board_sweep import Build
from taction.verification.studies.measured_board import MeasuredBoard, Start, measure_boards
from taction.verification.studies.part_influence import influences
from taction.verification.studies.running.collecting import Pace
from taction.verification.studies.running.executors import in_this_process
from taction.verification.studies.running.versions import own_version
from taction.verification.studies.tolerance.corners import CornerStudy, worst_of
from taction.verification.studies.tolerance.drawing import SampleCollection, run_samples
from taction.verification.studies.tolerance.samples import BoardSample, Quantity, Varied
from taction.verification.studies.tolerance.yield_report import YieldReport, summarise_samples
from taction.verification.studies.wanted_checks import Wanted

PARAM = "param"  # kind of a parameter


class Parametric(Protocol):
    """A deck whose ``.param`` cards can be moved."""

    def at(self, changes: Sequence[Mapping[str, float]], /) -> Sequence[Circuit | InputError]:
        """Return the circuit at some values, or why there is none."""

    def value_of(self, parameter: str, /) -> float | None:
        """Return the value of one, None if it is no number."""


def _none(changes: Sequence[Mapping[str, float]]) -> Sequence[Circuit | InputError]:
    raise ValueError(f"a board without parameters has no {changes[0]}")


def _nominal(deck: Parametric | None, name: str) -> float:
    value = None if deck is None else deck.value_of(name)
    if not value:
        text = "a tolerance needs a .param whose value is a number other than 0"
        raise InputError("--tolerances", Complaint(f"params.{name}", f"{value}", text))
    return value


@dataclass(frozen=True, slots=True)
class Samples:
    """How many boards of a yield are drawn, and from which seed."""

    count: int = 300
    seed: int = 1


@dataclass(frozen=True, eq=False)
class VariedDeck(Varied):
    """The nominal board of a deck, its varied parts, and what is asked of its samples."""

    nominal: Circuit
    spread: Tolerances
    params: Mapping[str, float]  # nominal values of the .param that vary; last in `varied`
    build: Build
    varied: tuple[Parameter, ...]
    asked: Wanted
    initial: Start
    wanted_rest: Floats  # of the nominal board, V
    scale: float  # largest step of the nominal board; else its largest output, or 1 V
    version: str

    @classmethod
    def of(
        cls, found: MeasuredBoard, spread: DeckTolerances, asked: Wanted, deck: Parametric | None
    ) -> VariedDeck:
        """Return the boards around a measured one.

        Raises
        ------
        InputError
            A ``.param`` that varies is no number other than 0.
        """
        nominal = found.board.circuit
        largest = float(np.abs(found.rest).max(initial=0.0))
        scale = found.measurements.amplitude or largest or 1.0
        params = {name: _nominal(deck, name) for name in spread.params}
        varied = (
            *parameters(nominal, spread.parts),
            *(Parameter(name, PARAM, share) for name, share in spread.params.items()),
        )
        return cls(
            nominal,
            spread.parts,
            params,
            _none if deck is None else deck.at,
            varied,
            asked,
            found.initial,
            found.rest,
            scale,
            own_version(False),
        )

    @property
    def name(self) -> str:
        """The name of the deck."""
        return self.nominal.name

    @property
    def engine(self) -> str:
        """The state-space engine."""
        return "statespace"

    @property
    def tolerances(self) -> Tolerances:
        """Of its parts."""
        return self.spread

    @property
    def target(self) -> Floats:
        """The outputs of the nominal board at rest, V."""
        return self.wanted_rest

    @property
    def step_amplitude(self) -> float:
        """Largest step of the nominal board, V."""
        return self.scale

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Its readings, how far it rests from the nominal board, its growth rate and margin."""
        limits = self.asked.limits
        found = [
            Quantity(
                name,
                kind.unit,
                at_most=self._limit(name),
                band=limits.settling_time.band if name == "settling_time" else None,
            )
            for name, kind in READINGS.items()
        ]
        found.append(Quantity("steady_state", "step"))
        if self.asked.oscillates:
            found.append(Quantity("growth_rate", "1/s", -1.0, at_least=0.0))
        else:
            found.append(Quantity("growth_rate", "1/s", at_most=0.0))
        if limits.stability.margin > 1.0:
            found.append(Quantity("margin", "ratio", -1.0, at_least=limits.stability.margin))
        if limits.noise is not None:
            found.append(Quantity("noise", "V", at_most=self._limit("noise")))
        return tuple(found)

    def _limit(self, name: str) -> float | None:
        if name not in self.asked.names:
            return None
        return getattr(getattr(self.asked.limits, name), "max", None)

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
            nominal = self.build([self._values(z[count:]) for z in each])
        for board, z in zip(nominal, each, strict=True):
            try:
                if isinstance(board, InputError):
                    raise board
                yield vary(board, self.spread, z[:count])
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
            requests, measure_boards(boards, self.initial, band), strict=True
        ):
            yield self._sample(number, found) if isinstance(found, MeasuredBoard) else found

    def _sample(self, number: int, found: MeasuredBoard) -> BoardSample:
        """Return the sample of a measured board."""
        limits, margin, noise = self.asked.limits, None, None
        if limits.stability.margin > 1.0:
            margin, _ = influences(found.board, found.poles, every=True)
        if limits.noise is not None:
            noise = found.noise(self.asked.lowest)
        record = found.record(found.checks(self.asked, noise, margin), noise, margin)
        errors = (found.rest - self.target) / self.scale
        figures: dict[str, float | None] = dict(record.figures)
        figures["steady_state_error"] = float(np.abs(errors).max(initial=0.0))
        record = replace(record, figures=figures, channels=())
        return BoardSample(number, record, tuple(errors.tolist()))


def varied_outcomes(
    found: MeasuredBoard,
    spread: DeckTolerances,
    asked: Wanted,
    samples: Samples,
    deck: Parametric | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> tuple[CornerStudy, YieldReport]:
    """Return the worst corners of a board within its tolerances, and the yield of its samples.

    Parameters
    ----------
    deck : Parametric, optional
        Builds the board at other values of its ``.param`` cards.

    Raises
    ------
    InputError
        A ``.param`` that varies is no number other than 0.
    EngineError
        The nominal board, or one at a corner, has no equilibrium.
    """
    board, tally = VariedDeck.of(found, spread, asked, deck), SampleCollection(samples.count)
    pace = Pace()
    with in_this_process() as workers:
        corners = worst_of(board, workers, progress)
        for _ in run_samples(board, range(samples.count), samples.seed, workers, tally):
            left = pace.ended(samples.count - len(tally.samples))
            progress(f"yield: {len(tally.samples)} of {samples.count} samples{left}")
    return corners, summarise_samples(board, tally.samples, samples.seed)
