"""Draw the samples of a Monte Carlo study until there are enough, with or without a database.

A study that was killed continues with the next sample. The key of a sample is a digest of board,
checks, seed and versions, so samples of several studies and the points of sweeps share a file
without being mixed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from taction.netlist_gen.board.variation import draw
from taction.system.array_types import Floats
from taction.system.progress import Progress
from taction.verification.studies.running.collecting import Pace
from taction.verification.studies.running.versions import digest
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.store import Store
from taction.verification.studies.tolerance.samples import BoardSample, Varied, evaluate_all
from taction.verification.studies.tolerance.varied_board import VariedBoard
from taction.verification.studies.tolerance.yield_report import MIN_SAMPLES, interval


class SampleStore:
    """The samples of one board and seed in a store."""

    def __init__(self, store: Store, board: VariedBoard, seed: int) -> None:
        problem = (board.problem.matrix, board.problem.strain)
        self._store = store
        self._base = digest(board.version, board.scene, *problem, board.nominal, seed)

    def get(self, number: int) -> BoardSample | None:
        """Return a sample, if it is stored; errors as `Store.record_of`."""
        return self._store.record_of(self._key(number), BoardSample)

    def put(self, sample: BoardSample) -> None:
        """Store a sample; errors as `taction.verification.studies.store.Store.put`."""
        self._store.put(self._key(sample.number), sample)

    def _key(self, number: int) -> bytes:
        return digest(self._base, number)


@dataclass(slots=True)
class SampleCollection:
    """Samples in the order of their numbers, until there are enough.

    The yield does not depend on the order in which the samples end.
    """

    limit: int
    width: float | None = None  # requested half width of the confidence interval
    samples: list[BoardSample] = field(default_factory=list)  # numbers 0, 1, 2 ... without a gap
    passed: int = 0
    enough: bool = False
    _waiting: dict[int, BoardSample] = field(default_factory=dict)  # a lower number is missing

    def add(self, sample: BoardSample) -> None:
        """Take a sample; it is counted as soon as all lower numbers are counted."""
        self._waiting[sample.number] = sample
        while not self.enough and (following := self._waiting.pop(len(self.samples), None)):
            self.samples.append(following)
            self.passed += following.outcome == "pass"
            self.enough = len(self.samples) >= self.limit or self._narrow()

    def _narrow(self) -> bool:
        if self.width is None or len(self.samples) < MIN_SAMPLES:
            return False
        low, high = interval(self.passed, len(self.samples))
        return 0.5 * (high - low) <= self.width


def run_samples(
    board: Varied,
    numbers: Iterable[int],
    seed: int,
    workers: Workers,
    collection: SampleCollection,
    store: SampleStore | None = None,
) -> Iterator[BoardSample]:
    """Draw samples into `collection` until it has enough; yield the computed ones as they end.

    Samples in `store` are not computed again; computed samples are added to it.

    Raises
    ------
    InputError, NoVerdictError, OutOfDisk
        As `taction.verification.studies.tolerance.samples.evaluate_all` and `SampleStore`.
    """

    def missing() -> Iterator[tuple[int, Floats]]:
        for number in numbers:
            if collection.enough:
                return
            if store is not None and (stored := store.get(number)) is not None:
                collection.add(stored)
            else:
                yield number, draw(board.tolerances, board.varied, seed, number)

    for sample in evaluate_all(
        board, missing(), workers, collection.limit, lambda: collection.enough
    ):
        if store is not None:
            store.put(sample)
        collection.add(sample)
        yield sample


def draw_samples(
    board: VariedBoard,
    seed: int,
    collection: SampleCollection,
    workers: AbstractContextManager[Workers],
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
    label: str = "yield",
) -> None:
    """Draw samples into `collection` until it has enough; an interruption keeps those it has.

    Parameters
    ----------
    workers : context manager
        Starts its processes with the first sample that has to be computed.
    output : path, optional
        A database; samples that it holds are not computed again.
    label : str
        What is drawn, before the numbers of `progress`.

    Raises
    ------
    InputError, NoVerdictError, OutOfDisk
        See `SampleStore` and `run_samples`.
    """
    with ExitStack() as stack:
        store = None
        if output is not None:
            store = SampleStore(stack.enter_context(Store(str(output))), board, seed)
        ready = stack.enter_context(workers)
        pace = Pace()
        for _ in run_samples(board, range(collection.limit), seed, ready, collection, store):
            count = f"{len(collection.samples)} of {collection.limit} samples"
            left = pace.ended(collection.limit - len(collection.samples))
            progress(f"{label}: {count}, {collection.passed} pass{left}")
