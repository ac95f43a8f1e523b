"""Boards whose parts deviate from their nominal values, and what is known of each of them.

Monte Carlo and corners see a `Varied` board only: that of a scene (`VariedBoard`), or of a deck
(`verification.studies.decks.board_sweep`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import Parameter, draw, parameters, vary
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.documents import HIDDEN, INLINE
from taction.system.errors import Complaint, InputError
from taction.system.quantities import banded
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.studies.running.study import Workers, study
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import ERROR, Record, finite, signed_errors
from taction.verification.verdict.simulation import choose_engine
from taction.verification.verdict.verify import verify


@dataclass(frozen=True, slots=True)
class BoardSample:
    """One board with deviating components, and the record of its verdict."""

    number: int  # in the study; number and seed determine the deviations
    record: Annotated[Record, INLINE]  # of the whole board
    # Equilibrium minus reference by channel, fractions of the step amplitude; empty where they are
    # not known.
    errors: Annotated[tuple[float, ...], "step"] = ()

    @property
    def outcome(self) -> str:
        """Outcome of the record."""
        return self.record.outcome

    @property
    def undecided(self) -> bool:
        """Whether the checks decide nothing, or no verdict was reached."""
        return self.record.outcome in (Outcome.INCONCLUSIVE.value, ERROR)

    @property
    def lost(self) -> str:
        """Why no verdict was reached, in one line; empty of a verdict."""
        return self.record.reason.partition("\n")[0] if self.record.failure else ""

    def value(self, name: str) -> float | None:
        """Return a `Quantity` of the board, by its name; None where the board lacks it."""
        if name == "rise_time" and (check := self.record.check(name)) is not None:
            return finite(check.value)  # of the channel that a scene checks
        return self.record.value("steady_state_error" if name == "steady_state" else name)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A reported quantity, its unit, the direction that is worse, and what its check accepts.

    `low`, `median` and `high` are its quantiles at 5 %, 50 % and 95 % over samples, each the value
    of one sample: infinite for one that never settles.
    """

    name: str
    unit: str  # "s", "step" (fraction of the step amplitude), "1/s", "V" or "ratio"
    worse: Annotated[float, HIDDEN] = 1.0  # 1: larger, -1: smaller
    at_least: float | None = None
    at_most: float | None = None
    band: float | None = None  # of a settling time, fraction of the step amplitude
    low: float = math.nan
    median: float = math.nan
    high: float = math.nan
    missing: int = 0  # samples without the quantity

    @property
    def title(self) -> str:
        """The name in words."""
        return banded(self.name, self.band)

    @property
    def limits(self) -> tuple[float | None, float | None]:
        """The least and the largest value that its check accepts."""
        return self.at_least, self.at_most


@dataclass(frozen=True, eq=False)
class Varied(ABC):
    """A nominal board, its varied parameters, and the data that all its samples share."""

    name: str  # of the study
    engine: str
    nominal: Circuit  # the board without deviations
    varied: tuple[Parameter, ...]  # in the order of the deviations z
    tolerances: Tolerances  # of the parts
    quantities: tuple[Quantity, ...]  # what is reported of the samples
    target: Floats  # (N,): the outputs at rest that are wanted, V
    step_amplitude: float  # largest step of any output, V; not a number without a step

    @abstractmethod
    def measured(self, number: int, z: Floats) -> BoardSample:
        """Return the sample with deviations `z`; any error ends it."""

    def at(self, z: Floats) -> Circuit:
        """Return the board with deviations `z`, (components,), in tolerances."""
        return vary(self.nominal, self.tolerances, z)

    def drawn(self, seed: int, number: int) -> Floats:
        """Return the deviations of a sample, (components,), in tolerances."""
        return draw(self.tolerances, self.varied, seed, number)


def evaluate_all(
    board: Varied, requests: Iterable[tuple[int, Floats]], workers: Workers
) -> Iterator[BoardSample]:
    """Yield the samples of `requests`, (number, z) each; one without a verdict is a sample, too."""
    points = ((number, (board, number, z)) for number, z in requests)
    yield from (sample for _, sample in study(workers, type(board).measured, points, _lost))


def _lost(error: BaseException, reason: str, board: Varied, number: int, _: Floats) -> BoardSample:
    return BoardSample(number, Record.without_verdict(error, board.engine, reason))


def quantities(scene: Scene) -> tuple[Quantity, ...]:
    """Return the quantities that are reported of the samples of `scene`, with their limits."""
    checks = scene.checks

    def limited(name: str, unit: str, band: float | None = None) -> Quantity:
        """Return a quantity with the limits of the check of its name."""
        check = getattr(checks, name)
        least, most = getattr(check, "min", None), getattr(check, "max", None)
        return Quantity(name, unit, 1.0, least, most, band)

    reported = [
        limited("settling_time", "s", checks.settling_time.band),
        *(limited(name, "step") for name in EXCURSIONS),
        Quantity("steady_state", "step", at_most=checks.steady_state.tolerance),
        Quantity("growth_rate", "1/s", at_most=0.0),
    ]
    if checks.rise_time is not None:
        reported.append(limited("rise_time", "s"))
    if checks.stability.margin > 1:
        reported.append(Quantity("margin", "ratio", -1.0, at_least=checks.stability.margin))
    if checks.noise is not None:
        reported.append(limited("noise", "V"))
    return tuple(reported)


@dataclass(frozen=True, eq=False)
class VariedBoard(Varied):
    """The nominal board of a scene, its varied parameters, and what all its samples share."""

    scene: Scene
    problem: InverseProblem
    ideal: IdealAnswer  # independent of the components
    full_margin: bool  # see `taction.verification.verdict.verify.verify`

    def measured(self, number: int, z: Floats) -> BoardSample:
        """Return the sample with deviations `z`; errors as `verify`."""
        scene, problem = self.scene.with_engine(self.engine), self.problem
        verdict = verify(scene, problem=problem, circuit=self.at(z), ideal=self.ideal,
                         full_margin=self.full_margin)  # fmt: skip
        errors, record = signed_errors(verdict), Record.of(verdict, channels=False)
        known = errors if all(map(math.isfinite, errors)) else ()
        return BoardSample(number, record.without_run_time(), known)


def prepare(scene: Scene, *, full_margin: bool = False) -> VariedBoard:
    """Build the nominal board of `scene` and solve its problem; refuse one that never varies."""
    problem = make_problem(scene)
    nominal = synthesise(scene, problem)
    varied = parameters(nominal, scene.tolerances)
    if not varied:
        text = "every tolerance is zero: nothing varies"
        raise InputError(scene.file, Complaint("tolerances", "", text))
    ideal = ideal_answer(ideal_network(problem, scene), scene)
    return VariedBoard(
        name=scene.name,
        engine=choose_engine(scene),
        nominal=nominal,
        varied=varied,
        tolerances=scene.tolerances,
        quantities=quantities(scene),
        target=ideal.target,
        step_amplitude=float(np.abs(ideal.target - ideal.start).max()) or math.nan,
        scene=scene,
        problem=problem,
        ideal=ideal,
        full_margin=full_margin,
    )
