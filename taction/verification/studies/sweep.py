"""Sweeps: verify every point of a grid, store each result at once, and compute no point twice.

The grid is generated lazily, only a few points are being computed at a time, and results live in
the store. A failed verification is a result like any other.
"""

from __future__ import annotations

import csv
import math
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from taction.netlist_gen.scene.axes import (
    ENGINE,
    Fixed,
    Over,
    SweepAxis,
    check_axes,
    fixed_values,
    parse_axes,
    with_values,
)
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.keys import Value, files_of
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import INLINE
from taction.system.errors import MACHINE_FAILURES, Complaint, InputError, Interrupted, TactionError
from taction.system.output_files import check_extra, check_file, replacing
from taction.system.progress import Notice, Progress
from taction.system.results import Result
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.cluster import workers_at
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import Workers, study
from taction.verification.studies.running.versions import digest, file_content, study_key
from taction.verification.verdict.record import ERROR, FIGURES, Record
from taction.verification.verdict.simulation import choose_engine
from taction.verification.verdict.verify import verify

MAX_POINTS = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Everything that defines a sweep of at most `MAX_POINTS` points."""

    scene: Scene
    groups: Sequence[Sequence[SweepAxis]]  # they span the grid; the axes of a group change together
    engine: str

    def __post_init__(self) -> None:
        if self.points > MAX_POINTS:
            text = f"at most {MAX_POINTS} points in one sweep"
            raise InputError("--over", Complaint("points", repr(self.points), text))

    @property
    def axes(self) -> tuple[SweepAxis, ...]:
        """All axes, in the order of the grid."""
        return tuple(axis for group in self.groups for axis in group)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each group."""
        return tuple(len(group[0]) for group in self.groups)

    @property
    def points(self) -> int:
        """Number of points of the grid."""
        return math.prod(self.shape)

    def values_at(self, place: int) -> dict[str, Value]:
        """Return the values at a place of the grid, in its order from 0, by their paths."""
        at = zip(self.groups, np.unravel_index(place, self.shape), strict=True)
        return {axis.key.path: axis.values[k] for group, k in at for axis in group}


def grid_points(
    plan: Plan, places: Iterable[int] | None = None
) -> Iterator[tuple[int, dict[str, Value], bytes]]:
    """Yield place from 0, values by their paths, and key of points of a plan, by default of all.

    The key is a digest of the scene at the point, and of all else that its result depends on.
    """
    scene = plan.scene.model_dump(by_alias=True, exclude={"name", "regression", "analysis"})
    analysis = plan.scene.analysis.model_dump(exclude={"engine", "timeout"})
    base, named = study_key(plan.engine, scene, analysis), files_of(plan.scene)
    content = cache(partial(file_content, plan.scene))
    for place in range(plan.points) if places is None else map(int, places):
        values = plan.values_at(place)
        names = [values.get(path, name) for path, name in named.items()]
        files = [content(name) if isinstance(name, str) else b"" for name in names]
        yield place, values, digest(base, values, files)


def sweep_points(
    plan: Plan, store: Store, workers: Workers, *, progress: Progress = lambda line: None
) -> tuple[int, Counter[str]]:
    """Compute every point of `plan` that `store` does not have, or has without a verdict.

    Return how many were computed now, and how many of all have each outcome.
    """
    outcomes, missing = Counter[str](), []
    for place, _, key in grid_points(plan):
        outcome = store.outcome_of(key)
        if outcome in (None, ERROR):
            missing.append(place)
        else:
            outcomes[outcome] += 1
    if not missing:
        return 0, outcomes
    progress(Notice(f"computing {len(missing)} of {plan.points} points"))

    def finish(key: bytes, record: Record) -> None:
        store.put(key, record)
        outcomes[record.outcome] += 1
        every = ", ".join(f"{number} {name}" for name, number in sorted(outcomes.items()))
        progress(f"{outcomes.total()} of {plan.points} points; {every}")

    def requests() -> Iterator[tuple[bytes, tuple[Scene, InverseProblem]]]:
        """Yield key, scene and problem of each point; one whose scene cannot be made ends here."""
        for _, values, key in grid_points(plan, missing):
            try:
                scene = with_values(plan.scene, values | {ENGINE: plan.engine})
                yield key, (scene, make_problem(scene))
            except MACHINE_FAILURES:  # ngspice was removed: no result of a point
                raise
            except TactionError as error:
                finish(key, Record.without_verdict(error, plan.engine))

    for key, record in study(workers, _compute, requests(), _without_verdict):
        finish(key, record)
    return len(missing), outcomes


def _compute(scene: Scene, problem: InverseProblem) -> Record:
    return Record.of(verify(scene, problem=problem), channels=False)


def _without_verdict(error: BaseException, reason: str, scene: Scene, _: InverseProblem) -> Record:
    return Record.without_verdict(error, scene.analysis.engine, reason)


def computed(
    plan: Plan,
    store: Store,
    *,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> tuple[int, Counter[str]]:
    """Compute what `store` lacks, by processes here or a cluster."""
    try:
        with workers_at(cluster, jobs, progress) as workers:
            return sweep_points(plan, store, workers, progress=progress)
    except KeyboardInterrupt:
        stored = f"{store.count()} results are in {store.path}; the same command continues"
        raise Interrupted(stored) from None


COLUMNS = ("engine", "stable", *FIGURES, "outcome", "failure", "state", "simulator", "reason")
OUTCOMES = ("pass", "fail", "inconclusive", "error")


def all_records(plan: Plan, store: Store) -> Iterator[dict[str, Any] | None]:
    """Yield each point in the order of the grid, its values by names; None if not stored."""
    names = {axis.key.path: axis.name for axis in plan.axes}
    for _, at, key in grid_points(plan):
        record = store.record_of(key, dict[str, Any])
        if record is None:
            yield None
            continue
        rate, frequency = record["growth_rate"], record["frequency"]
        pole = None if rate is None else [rate, 2.0 * math.pi * frequency]
        values = {names[path]: value for path, value in at.items()}
        yield {"values": values, **record, "rightmost_pole": pole}


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """A point of a sweep; `values` by the names of the axes."""

    values: dict[str, Value]
    record: Annotated[Record, INLINE]
    rightmost_pole: Annotated[tuple[float, ...] | None, "1/s"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SweepResult(Result):
    """Every point of a sweep."""

    VIEW = "taction.verification.report.views.sweep_view:view"
    CARD = "Sweep"
    DOCUMENT = (
        *("scene = plan.scene.name", "file = plan.scene.file", "database = store.path"),
        "axes = plan.axes",
        *("engine = plan.engine", "total = plan.points", "done", "ran", "outcomes"),
        "seconds [s]",
        "points",
    )

    plan: Plan  # the grid: the axes, their values, the engine
    store: Store  # a database in a file or in memory, open as long as the result exists
    ran: int  # points computed now
    outcomes: Mapping[str, int]  # how many points have each outcome
    seconds: float = 0.0  # wall time
    strict: bool = False  # whether a point that fails makes the outcome fail

    @property
    def done(self) -> int:
        """Number of points that were computed now, or stored before."""
        return sum(self.outcomes.values())

    @property
    def points(self) -> tuple[SweepPoint, ...]:
        """All of `records`, which are plain data already."""
        return cast(tuple[SweepPoint, ...], tuple(self.records()))

    @property
    def outcome(self) -> str:
        """``fail`` if `strict` and a point fails; ``inconclusive`` if no point has a verdict."""
        if self.strict and self.outcomes.get("fail"):
            return "fail"
        known = self.outcomes.get("pass") or self.outcomes.get("fail")
        return "pass" if known else "inconclusive"

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield every point as plain data in SI base units, in the order of the grid."""
        return filter(None, all_records(self.plan, self.store))

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame``: a row for each point, a column for each figure.

        InputError: pandas is not installed.
        """
        check_extra("data", "to_pandas")
        import pandas as pd

        return pd.DataFrame(_rows(self), columns=_columns(self.plan))


def sweep(
    scene: str | Path | Scene,
    *,
    over: Over,
    engine: str | None = None,
    fix: Fixed = (),
    strict: bool = False,
    output: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> SweepResult:
    """Verify SCENE at every point of a grid and store the results.

    A point without a verdict has its reason. The same command continues an interrupted sweep, and
    computes points without a verdict again.

    Parameters
    ----------
    scene : path or Scene
        The scene whose values change.
    over : mapping, str or iterable of str
        Axis of the grid: C=1pF:1nF:31 (31 points, logarithmic), C=1pF:1nF:31:lin (linear) or
        C=1p,2p (values). Two axes in one option, with a blank between them, change together. Repeat
        the option for a grid.

        In Python the axes by key: a tuple ``("1pF", "1nF", 31)`` is a range of 31 points with
        logarithmic spacing (``("1pF", "1nF", 31, "lin")``: linear), a list holds the values.
        Strings are read as on the command line (``"C=1pF:1nF:31"``).
    engine : str, optional
        Engine in the place of the scene's own.
    fix : mapping, str or iterable of str
        Hold a key at every point, by default at the scene's own value: --fix lambda holds lambda
        where the scene gives a resistance. Repeat the option for several keys.

        In Python ``"lambda"``, or ``{"lambda": 0.5}`` or ``"lambda=0.5"`` for another value.
    strict : bool
        A point that fails makes the outcome of the sweep fail.
    output : path, optional
        Database of the results; by default the name of the scene's file with the ending .sqlite.

        Points that it holds are not computed again. In Python the points stay in memory by
        default.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the number of finished points with the remaining time.

    Returns
    -------
    SweepResult
        `to_pandas`, `plot` and `records` give the points.

    Raises
    ------
    InputError
        The scene, an axis or the database cannot be used.
    NoVerdictError
        A point needs ngspice and ngspice is missing, or the cluster is gone.

    Examples
    --------
    >>> import taction
    >>> result = taction.sweep(
    ...     "scenes/paper-breadboard.toml",
    ...     over={"C": ("8pF", "20pF", 2), "opamp.base": ["ideal", "ua741"]},
    ...     engine="statespace",
    ...     jobs=1,
    ... )
    >>> result
    SweepResult('paper-breadboard', 4 of 4 points: 4 fail)
    >>> result.to_pandas()["stable"].tolist()
    [False, True, True, True]
    """
    scene = read_scene(scene)
    fixed = fixed_values(scene, fix)
    scene = with_values(scene, fixed) if fixed else scene
    axes = parse_axes(scene, over)
    check_axes(axes, fixed)
    plan = Plan(scene, axes, choose_engine(scene if engine is None else scene.with_engine(engine)))
    store, start = Store(":memory:" if output is None else str(output)), time.perf_counter()
    counts = computed(plan, store, jobs=jobs, cluster=cluster, progress=progress)
    return SweepResult(plan, store, *counts, time.perf_counter() - start, strict)


def _columns(plan: Plan) -> list[str]:
    """Return the names of the columns of a table; a figure that is an axis has one column."""
    return [*dict.fromkeys([*(axis.name for axis in plan.axes), *COLUMNS])]


def _rows(result: SweepResult) -> Iterator[dict[str, Any]]:
    columns = _columns(result.plan)
    for record in result.records():
        flat = record | record["values"]
        yield {name: flat[name] for name in columns}


def grids(result: SweepResult) -> dict[str, np.ndarray[Any, Any]]:
    """Return the numbers of a sweep as arrays over the grid, NaN where there is none.

    ``outcome`` has places in `OUTCOMES`, -1 for a point that is not stored.
    """
    plan = result.plan
    found: dict[str, np.ndarray[Any, Any]] = {name: np.full(plan.shape, np.nan) for name in FIGURES}
    found["outcome"] = np.full(plan.shape, -1, dtype=np.int8)
    for place, record in enumerate(all_records(plan, result.store)):
        if record is not None:
            found["outcome"].flat[place] = OUTCOMES.index(record["outcome"])
            for name in FIGURES:
                if record[name] is not None:
                    found[name].flat[place] = record[name]
    return found


def export_sweep(result: SweepResult, path: str) -> None:
    """Write every point of a sweep to `path`, a row each."""
    check_file(path, "--export")
    with replacing(path) as temporary:
        if Path(path).suffix.lower() == ".parquet":
            import pyarrow as pa
            import pyarrow.parquet

            choices = [axis.name for axis in result.plan.axes if axis.key.kind == "choice"]
            rows = [row | {n: str(row[n]) for n in choices} for row in _rows(result)]
            pa.parquet.write_table(pa.Table.from_pylist(rows), temporary)
        else:
            with temporary.open("w", encoding="utf-8", newline="") as file:
                writer = csv.DictWriter(file, _columns(result.plan))
                writer.writeheader()
                writer.writerows(_rows(result))
