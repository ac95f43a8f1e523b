"""Draw the samples of a Monte Carlo study until there are enough, with or without a database.

A study that was killed continues with the next sample. The key of a sample is a digest of board,
checks, seed and versions, so samples of several studies and the points of sweeps share a file
without being mixed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError, Interrupted
from taction.system.progress import Notice, Progress
from taction.system.quantities import fraction
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.pool import Workers
from taction.verification.studies.running.study import workers_at
from taction.verification.studies.running.versions import digest
from taction.verification.studies.store import Store
from taction.verification.studies.tolerance.samples import BoardSample, Varied, evaluate_all
from taction.verification.studies.tolerance.varied_board import VariedBoard, prepare
from taction.verification.studies.tolerance.yield_report import (
    MIN_SAMPLES,
    YieldReport,
    interval,
    summarise_samples,
)


def sample_keys(board: VariedBoard, seed: int) -> Callable[[int], bytes]:
    """Return the function that gives the key of a sample in a store, by its number."""
    problem = (board.problem.matrix, board.problem.strain)
    base = digest(board.version, board.scene, *problem, board.nominal, seed)
    return lambda number: digest(base, number)


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
    store: Store | None = None,
    key: Callable[[int], bytes] = lambda number: b"",
) -> Iterator[BoardSample]:
    """Draw samples into `collection` until it has enough; yield the computed ones as they end.

    Samples in `store`, where each has its `key`, are not computed again; computed samples are added
    to it.

    InputError, NoVerdictError, OutOfDisk: as
      `taction.verification.studies.tolerance.samples.evaluate_all` and `Store`.
    """

    def missing() -> Iterator[tuple[int, Floats]]:
        for number in numbers:
            if collection.enough:
                return
            stored = None if store is None else store.record_of(key(number), BoardSample)
            if stored is None:
                yield number, board.drawn(seed, number)
            else:
                collection.add(stored)

    limit = collection.limit
    for sample in evaluate_all(board, missing(), workers, limit, lambda: collection.enough):
        if store is not None:
            store.put(key(sample.number), sample)
        collection.add(sample)
        yield sample


def montecarlo(
    scene: str | Path | Scene,
    *,
    engine: str | None = "statespace",
    samples: int = 1000,
    seed: int = 1,
    until: str | float | None = None,
    min_yield: float | None = None,
    output: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> YieldReport:
    """Verify SCENE with random components within its [tolerances] and estimate the yield.

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    engine : str, optional
        Engine of all samples.

        ``"auto"``, ``"ngspice"`` or ``"statespace"``; None for the scene's own engine.
    samples : int
        Most samples to draw.
    seed : int
        Seed of the samples.

        Sample 17 of a seed is the same board on every machine.
    until : str or float, optional
        Stop when the half width of the 95 % interval is below this: 1% or 0.01.
    min_yield : float, optional
        Smallest yield that passes.
    output : path, optional
        Database that stores every sample; a later run computes only the missing ones.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the number of finished samples.

    Returns
    -------
    YieldReport
        The yield (a sample without a verdict counts as not passed), its 95 % interval, the failed
        checks, the parts with the largest influence; `plot` draws histograms.

    Raises
    ------
    InputError
        The scene, the tolerances or the database cannot be used.
    NoVerdictError
        The problem has no solution, or a sample needs ngspice and ngspice is missing.
    Interrupted
        Ctrl-C; its `result` has the finished samples.

    Examples
    --------
    >>> import taction
    >>> taction.montecarlo("scenes/tuned-breadboard.toml", samples=4, jobs=1).samples
    4
    """
    tally = SampleCollection(samples, half_width(until))
    board = prepare(read_scene(scene, engine))
    complete, path = True, ":memory:" if output is None else str(output)
    try:
        announced = workers_at(cluster, jobs, lambda text: progress(Notice(text)))
        with Store(path) as store, announced as workers:
            keys = sample_keys(board, seed)
            for _ in run_samples(board, range(samples), seed, workers, tally, store, keys):
                done = len(tally.samples)
                progress(f"yield: {done} of {samples} samples, {tally.passed} pass")
    except KeyboardInterrupt:
        complete = False
    report = summarise_samples(board, tally.samples, seed)
    report = replace(report, min_yield=min_yield, complete=complete, scene=board.scene)
    if not complete:
        raise Interrupted("the report holds the finished samples", report)
    return report


def half_width(until: str | float | None) -> float | None:
    """Return the requested half width of the confidence interval, from ``"1%"`` or 0.01.

    InputError: the half width is not between 0 and 0.5.
    """
    value = None
    if until is not None:
        with suppress(ValueError):
            value = fraction(until)
        if value is None or not 0 < value < 0.5:
            accepted = "expected a half width such as 1% or 0.01"
            raise InputError("--until", Complaint("WIDTH", repr(until), accepted))
    return value
