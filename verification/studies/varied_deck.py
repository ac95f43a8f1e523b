"""A board without a scene whose parts vary: its samples, worst corners and yield.

Corners and Monte Carlo are those of scenes (`verification.studies.tolerance`). The outputs at rest
are compared with those of the nominal board.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import Parameter, parameters
from taction.netlist_gen.scene.checks import Tolerances
from taction.system.array_types import Floats
from taction.system.reading_definitions import READINGS
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.studies.measured_board import MeasuredBoard, Start, measure_boards
from taction.verification.studies.part_influence import influences
from taction.verification.studies.running.collecting import Pace
from taction.verification.studies.running.executors import in_this_process
from taction.verification.studies.running.versions import Versions, own_versions
from taction.verification.studies.tolerance.corners import CornerStudy, worst_of
from taction.verification.studies.tolerance.drawing import SampleCollection, run_samples
from taction.verification.studies.tolerance.samples import BoardSample, Quantity, Varied
from taction.verification.studies.tolerance.yield_report import YieldReport, summarise_samples
from taction.verification.studies.wanted_checks import Wanted

ONLY_STABLE: dict[str, dict[str, float]] = {
    "stability": {}
}  # what is checked of the boards where nothing was asked for


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
    varied: tuple[Parameter, ...]
    asked: Wanted
    initial: Start
    wanted_rest: Floats  # of the nominal board, V
    scale: float  # largest step of the nominal board; else its largest output, or 1 V
    versions: Versions

    @classmethod
    def of(cls, found: MeasuredBoard, spread: Tolerances, asked: Wanted) -> VariedDeck:
        """Return the boards around a measured one; without checks they have to be stable."""
        nominal = found.board.circuit
        if not asked.anything:
            asked = replace(asked, tables=ONLY_STABLE)
        largest = float(np.abs(found.rest).max(initial=0.0))
        scale = found.measurements.amplitude or largest or 1.0
        varied = parameters(nominal, spread)
        return cls(
            nominal, spread, varied, asked, found.initial, found.rest, scale, own_versions(False)
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
            Quantity(name, kind.unit, at_most=self._limit(name)) for name, kind in READINGS.items()
        ]
        found += [Quantity("steady_state", "step"), Quantity("growth_rate", "1/s", at_most=0.0)]
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
        boards = (LinearBoard(self.at(z)) for _, z in requests)
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
    spread: Tolerances,
    asked: Wanted,
    samples: Samples,
    progress: Callable[[str], None] = lambda stage: None,
) -> tuple[CornerStudy, YieldReport]:
    """Return the worst corners of a board within its tolerances, and the yield of its samples.

    Raises
    ------
    EngineError
        The nominal board, or one at a corner, has no equilibrium.
    """
    board, tally = VariedDeck.of(found, spread, asked), SampleCollection(samples.count)
    pace = Pace()
    with in_this_process() as workers:
        corners = worst_of(board, workers, progress)
        for _ in run_samples(board, range(samples.count), samples.seed, workers, tally):
            left = pace.ended(samples.count - len(tally.samples))
            progress(f"yield: {len(tally.samples)} of {samples.count} samples{left}")
    return corners, summarise_samples(board, tally.samples, samples.seed)
