"""Boards whose parts deviate within their tolerances, and their yield with its confidence interval.

Monte Carlo and corners see a `Varied` board only: that of a scene (`VariedBoard`), or of a deck
(`verification.studies.decks.board_sweep`). Every sample has its own random stream: sample 17 of
seed 1 is the same board on any machine and in any order. A sample without a verdict counts as one
that does not pass. The key of a sample in a database is a digest of board, checks, seed and
versions.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import Parameter, draw, influences, parameters, vary
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.keys import files_of
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.documents import HIDDEN, INLINE
from taction.system.errors import Complaint, InputError, Interrupted
from taction.system.progress import Progress
from taction.system.quantities import banded, percent
from taction.system.reading_definitions import EXCURSIONS
from taction.system.results import Result
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.cluster import workers_at
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import Workers, study
from taction.verification.studies.running.versions import digest, file_content, study_key
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import ERROR, Record, finite, signed_errors
from taction.verification.verdict.simulation import choose_engine
from taction.verification.verdict.verify import verify

CONFIDENCE = 0.95
QUANTILES = (0.05, 0.5, 0.95)
CHECK_OF = {"growth_rate": "stability", "margin": "stability"}  # of a quantity of another name


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
    of one sample: infinite for one that never settles. `parts` has its correlations with them, the
    strongest first; of the steady state those of the signed error of `channel`, the largest rms.
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
    channel: int | None = None  # from 1
    parts: Mapping[str, float] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The name in words."""
        return banded(self.name, self.band)


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
        wanted = "" if self.min_yield is None else f"; wanted: at least {percent(self.min_yield)}"
        return f"yield {share}, 95 % interval {low} to {high}: {counts}{wanted}"


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
        quantities=tuple(_spread(board, each, samples, seed) for each in board.quantities),
    )


def interval(passed: int, samples: int) -> tuple[float, float]:
    """Return Clopper and Pearson's exact interval of a yield; (0, 1) without samples."""
    from scipy.special import betaincinv

    tail, failed = 0.5 * (1.0 - CONFIDENCE), samples - passed
    low = float(betaincinv(passed, failed + 1, tail)) if passed else 0.0
    high = float(betaincinv(passed + 1, failed, 1.0 - tail)) if failed else 1.0
    return low, high


def _spread(board: Varied, quantity: Quantity, samples: list[BoardSample], seed: int) -> Quantity:
    """Return a quantity with its distribution over the samples, and the parts that move it."""
    found = {each.number: each.value(quantity.name) for each in samples if not each.lost}
    known = [value for value in found.values() if value is not None and not math.isnan(value)]
    missing = [*found.values()].count(None)
    if quantity.unit == "s":
        known += [math.inf] * missing  # it never settles
    low, median, high = np.quantile(known or [math.nan], QUANTILES, method="inverted_cdf").tolist()
    errors, channel = {each.number: each.errors for each in samples if each.errors}, None
    if quantity.name == "steady_state" and errors:
        channel = 1 + int(np.argmax(np.square([*errors.values()]).mean(axis=0)))
        found = {number: each[channel - 1] for number, each in errors.items()}
    parts = influences(board.tolerances, board.varied, seed, found)
    spread = replace(quantity, low=low, median=median, high=high, missing=missing)
    return replace(spread, channel=channel, parts=parts)


def sample_keys(board: VariedBoard, seed: int) -> Callable[[int], bytes]:
    """Return the function that gives the key of a sample in a store, by its number."""
    names = (name for name in files_of(board.scene).values() if isinstance(name, str))
    files = [file_content(board.scene, name) for name in names]
    base = study_key(board.engine, board.scene, files, seed)
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
    drawn = ((n, draw(board.tolerances, board.varied, seed, n)) for n in missing)
    for sample in evaluate_all(board, drawn, workers):
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
