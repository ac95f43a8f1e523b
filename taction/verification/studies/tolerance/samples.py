"""Boards whose parts deviate from their nominal values, and what is known of each of them.

Monte Carlo and corners see a `Varied` board only: a scene (`varied_board`), or a deck
(`verification.studies.board_sweep`).
"""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache, partial
from typing import Annotated

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import Parameter, draw, vary
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.system.array_types import Floats
from taction.system.documents import INLINE
from taction.system.quantities import banded
from taction.verification.studies.running.pool import Workers
from taction.verification.studies.running.study import attempted, study
from taction.verification.studies.running.versions import check_version
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import ERROR, Record, finite


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
    def failed(self) -> tuple[str, ...]:
        """Checks that do not pass."""
        return self.record.failed

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
        if name == "rise_time":  # of the channel that a scene checks
            check = self.record.check(name)
            return self.record.value(name) if check is None else finite(check.value)
        return self.record.value("steady_state_error" if name == "steady_state" else name)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A reported quantity, its unit, the direction that is worse, and what its check accepts."""

    name: str
    unit: str
    worse: float = 1.0  # 1: larger, -1: smaller
    at_least: float | None = None
    at_most: float | None = None
    band: float | None = None  # of a settling time, fraction of the step amplitude

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
    """A nominal board, its varied parameters, and the data that all its samples share.

    Every call to a worker sends it: it is pickled once and each worker unpickles it once, because
    pickling takes as long as varying the board.
    """

    # `name`, `engine`: what the study is called, and the engine of its samples.
    name: str
    engine: str
    nominal: Circuit  # the board without deviations
    varied: tuple[Parameter, ...]  # in the order of the deviations z
    tolerances: Tolerances  # of the parts
    quantities: tuple[Quantity, ...]  # what is reported of the samples
    target: Floats  # (N,): the outputs at rest that are wanted, V
    step_amplitude: float  # largest step of any output, V; not a number without a step
    version: str  # of the process that runs the study

    def by_statespace(self) -> Varied:
        """Return the same board with samples by the state-space engine."""
        return self

    @abstractmethod
    def measured(self, number: int, z: Floats) -> BoardSample:
        """Return the sample with deviations `z`; any error ends it."""

    @abstractmethod
    def measured_together(self, requests: Sequence[tuple[int, Floats]]) -> list[BoardSample | None]:
        """Return several samples, None for each one that needs a call of its own."""

    def at(self, z: Floats) -> Circuit:
        """Return the board with deviations `z`, (components,), in tolerances."""
        return vary(self.nominal, self.tolerances, z)

    def drawn(self, seed: int, number: int) -> Floats:
        """Return the deviations of a sample, (components,), in tolerances."""
        return draw(self.tolerances, self.varied, seed, number)

    @cached_property
    def _packed(self) -> bytes:
        return pickle.dumps(tuple(getattr(self, each.name) for each in fields(self)))

    def __reduce__(self) -> tuple[Callable[..., Varied], tuple[type[Varied], bytes]]:
        return _unpickled, (type(self), self._packed)


@lru_cache(maxsize=2)
def _unpickled(kind: type[Varied], packed: bytes) -> Varied:
    return kind(*pickle.loads(packed))  # noqa: S301 - part of a pickle


def evaluate(board: Varied, number: int, z: Floats) -> BoardSample:
    """Verify the board with deviations `z`; a verification that fails gives a sample, too.

    NoVerdictError: this process has other versions of taction or ngspice than `board`, or it can
      compute no sample; the sample itself may be right.
    """
    check_version(board.version)
    return attempted(partial(board.measured, number, z), partial(_without_verdict, number, board))


def _evaluate_together(*requests: tuple[Varied, int, Floats]) -> list[BoardSample | None]:
    """Evaluate several boards; None for each one that needs a call of its own."""
    board = requests[0][0]
    if len(requests) == 1:
        return [evaluate(*requests[0])]
    check_version(board.version)
    return board.measured_together([(number, z) for _, number, z in requests])


def _without_verdict(number: int, board: Varied, error: BaseException, reason: str) -> BoardSample:
    return BoardSample(number, Record.without_verdict(type(error).__name__, reason, board.engine))


def evaluate_all(
    board: Varied,
    requests: Iterable[tuple[int, Floats]],
    workers: Workers,
    count: int,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[BoardSample]:
    """Yield the samples of `requests`, (number, z) each, as they end, until `stopped` is true.

    There are at most `count` of them. A sample whose worker was killed several times has no
    verdict.

    NoVerdictError: as `taction.verification.studies.running.study.study`.
    """
    points = ((number, (board, number, z)) for number, z in requests)
    size = 1 if board.engine == "ngspice" else count  # processes share no work
    for number, sample in study(workers, _evaluate_together, points, size, stopped):
        if isinstance(sample, BaseException):
            sample = _without_verdict(number, board, sample, f"its worker was killed: {sample}")
        yield sample
