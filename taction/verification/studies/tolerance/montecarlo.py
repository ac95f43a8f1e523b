"""Yield of a board with component tolerances: samples and their confidence interval.

Every sample has its own random stream: sample 17 of seed 1 is the same board on any machine and in
any order. A sample without a verdict counts as one that does not pass. The key of a sample in a
database is a digest of board, checks, seed and versions.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.keys import files_of
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Interrupted
from taction.system.progress import Progress
from taction.system.quantities import percent
from taction.system.results import Result
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.cluster import workers_at
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import Workers
from taction.verification.studies.running.versions import (
    digest,
    file_content,
    own_code,
    simulator_name,
)
from taction.verification.studies.tolerance.varied_board import (
    BoardSample,
    Quantity,
    Varied,
    VariedBoard,
    evaluate_all,
    prepare,
)

CONFIDENCE = 0.95
QUANTILES = (0.05, 0.5, 0.95)
CHECK_OF = {"growth_rate": "stability", "margin": "stability"}  # of a quantity of another name


@dataclass(frozen=True, slots=True, repr=False)
class YieldReport(Result):
    """Yield of a Monte Carlo study, its interval, and what is behind it.

    Attributes
    ----------
    boards : tuple of BoardSample
        The samples, in the order of their numbers.
    reasons : dict of str to int
        Counts the causes of samples without a verdict.
    min_yield : float or None
        Smallest yield that passes.
    complete : bool
        Whether all samples were drawn; False after Ctrl-C.
    scene : Scene or None
        The board; None of a deck.
    """

    VIEW = "taction.verification.report.views.tolerance_view:yield_view"
    CARD = "Yield"
    DOCUMENT = (
        *("scene = name", "engine", "seed", "complete", "samples", "passed"),
        *("without_verdict", "fraction", "low", "high", "failures", "reasons", "quantities"),
    )

    name: str
    engine: str
    seed: int
    boards: tuple[BoardSample, ...] = field(compare=False)
    samples: int
    passed: int
    without_verdict: int
    fraction: float
    low: float
    high: float
    failures: dict[str, int]
    reasons: dict[str, int]
    quantities: tuple[Quantity, ...]
    min_yield: float | None = None
    complete: bool = True
    scene: Scene | None = field(default=None, compare=False)

    @property
    def outcome(self) -> str:
        """Whether the whole interval of the yield lies above `min_yield`, or below it."""
        if self.min_yield is None or self.low >= self.min_yield:
            return "pass"
        return "fail" if self.high < self.min_yield else "inconclusive"

    @property
    def sentence(self) -> str:
        """The yield in words, without a full stop."""
        if not self.samples:
            return "no sample, no yield"
        share, low, high = percent(self.fraction, 4), percent(self.low), percent(self.high)
        counts = f"{self.passed} of {self.samples} boards pass"
        return f"yield {share}, 95 % interval {low} to {high}: {counts}"


def summarise_samples(board: Varied, samples: list[BoardSample], seed: int) -> YieldReport:
    """Return the yield with its interval, failed checks and spreads."""
    samples = sorted(samples, key=lambda sample: sample.number)
    passed = sum(sample.outcome == "pass" for sample in samples)
    low, high = interval(passed, len(samples))
    failures = Counter(name for sample in samples for name in sample.record.failed)
    undecided = [sample for sample in samples if sample.undecided]
    return YieldReport(
        name=board.name,
        engine=board.engine,
        seed=seed,
        boards=tuple(samples),
        samples=len(samples),
        passed=passed,
        without_verdict=len(undecided),
        fraction=passed / len(samples) if samples else math.nan,
        low=low,
        high=high,
        failures=dict(failures.most_common()),
        reasons=dict(Counter(s.lost for s in undecided if s.lost).most_common()),
        quantities=tuple(_spread(quantity, samples) for quantity in board.quantities),
    )


def interval(passed: int, samples: int) -> tuple[float, float]:
    """Return Clopper and Pearson's exact interval of a yield; (0, 1) without samples."""
    from scipy.special import betaincinv

    tail, failed = 0.5 * (1.0 - CONFIDENCE), samples - passed
    low = float(betaincinv(passed, failed + 1, tail)) if passed else 0.0
    high = float(betaincinv(passed + 1, failed, 1.0 - tail)) if failed else 1.0
    return low, high


def _spread(quantity: Quantity, samples: list[BoardSample]) -> Quantity:
    """Return a quantity with its distribution over the samples."""
    values = [sample.value(quantity.name) for sample in samples if not sample.lost]
    missing = values.count(None)
    known = [value for value in values if value is not None and not math.isnan(value)]
    if quantity.unit == "s":
        known += [math.inf] * missing  # it never settles
    quantiles = (math.nan,) * len(QUANTILES)
    if known:
        quantiles = np.quantile(known, QUANTILES, method="inverted_cdf").tolist()
    low, median, high = quantiles
    return replace(quantity, low=low, median=median, high=high, missing=missing)


def sample_keys(board: VariedBoard, seed: int) -> Callable[[int], bytes]:
    """Return the function that gives the key of a sample in a store, by its number."""
    versions, scene = (own_code(), simulator_name(board.engine)), board.scene
    files = [file_content(scene, n) for n in files_of(scene).values() if isinstance(n, str)]
    base = digest(*versions, scene, files, seed)
    return lambda number: digest(base, number)


def run_samples(
    board: Varied, limit: int, seed: int, workers: Workers, store: Store | None = None
) -> Iterator[BoardSample]:
    """Yield the samples, those that `store` has first, and each other one as it ends.

    `store` keeps each sample at once; what it has is not computed.
    """
    key = sample_keys(board, seed) if store and isinstance(board, VariedBoard) else None
    missing = list[int]()
    for number in range(limit):
        stored = key and store and store.record_of(key(number), BoardSample)
        if stored:
            yield stored
        else:
            missing.append(number)
    for sample in evaluate_all(board, ((n, board.drawn(seed, n)) for n in missing), workers):
        if key and store:
            store.put(key(sample.number), sample)
        yield sample


def montecarlo(
    scene: str | Path | Scene,
    *,
    engine: str | None = "statespace",
    samples: int = 1000,
    seed: int = 1,
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
        Samples to draw.
    seed : int
        Seed of the samples.

        Sample 17 of a seed is the same board on every machine.
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
        checks; `plot` draws histograms. `corners` names the parts with the largest influence.

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
    board, found, passed = prepare(read_scene(scene, engine)), list[BoardSample](), 0
    complete, path = True, ":memory:" if output is None else str(output)
    try:
        with Store(path) as store, workers_at(cluster, jobs, progress) as workers:
            for sample in run_samples(board, samples, seed, workers, store):
                found.append(sample)
                passed += sample.outcome == "pass"
                progress(f"yield: {len(found)} of {samples} samples, {passed} pass")
    except KeyboardInterrupt:
        complete = False
    report = summarise_samples(board, found, seed)
    report = replace(report, min_yield=min_yield, complete=complete, scene=board.scene)
    if not complete:
        raise Interrupted("the report holds the finished samples", report)
    return report
