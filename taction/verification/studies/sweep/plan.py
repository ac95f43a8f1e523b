"""Sweeps: verify every point of a grid, store each result at once, and compute no point twice.

The grid is generated lazily, only a few points are being computed at a time, and results live in
the store. A failed verification is a result like any other.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

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
from taction.system.errors import MACHINE_FAILURES, Complaint, InputError, Interrupted, TactionError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.progress import Notice, Progress
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.pool import Workers
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import attempted, study, workers_at
from taction.verification.studies.running.versions import digest, own_code, simulator_name
from taction.verification.verdict.record import ERROR, Record
from taction.verification.verdict.simulation import choose_engine
from taction.verification.verdict.verify import verify

MAX_POINTS = 1_000_000
Point = tuple[Scene | Record, InverseProblem | None]  # a record where no scene can be made


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


@dataclass(frozen=True, slots=True)
class GridPoint:
    """One point of the grid."""

    place: int  # in the order of the grid, from 0
    values: dict[str, Value]
    key: bytes  # digest of the scene at the point, and of all else that its result depends on


def grid_points(plan: Plan, places: Iterable[int] | None = None) -> Iterator[GridPoint]:
    """Yield points of a plan, by default all, in the order of the grid."""
    scene = plan.scene.model_dump(by_alias=True, exclude={"name", "regression", "analysis"})
    analysis = plan.scene.analysis.model_dump(exclude={"engine", "timeout"})
    base = digest(own_code(), scene, analysis, simulator_name(plan.engine), plan.engine)
    named = files_of(plan.scene)

    @cache
    def content(name: str) -> bytes:
        with suppress(UnusableFileError):
            return hashlib.sha256(read_bounded(plan.scene.folder / name, LARGEST)).digest()
        return b""

    for place in range(plan.points) if places is None else map(int, places):
        values = plan.values_at(place)
        names = [values.get(path, name) for path, name in named.items()]
        files = [content(name) if isinstance(name, str) else b"" for name in names]
        yield GridPoint(place, values, digest(base, values, files))


def plan_sweep(
    scene: str | Path | Scene, over: Over, engine: str | None, *, fix: Fixed = ()
) -> Plan:
    """Return the grid of a sweep; arguments and errors are those of `sweep`."""
    scene = read_scene(scene)
    fixed = fixed_values(scene, fix)
    scene = with_values(scene, fixed) if fixed else scene
    axes = parse_axes(scene, over)
    check_axes(axes, fixed)
    return Plan(scene, axes, choose_engine(scene if engine is None else scene.with_engine(engine)))


@dataclass(slots=True)
class SweepCounts:
    """How many points a sweep has, and how they ended."""

    total: int
    ran: int = 0  # computed now
    outcomes: Counter[str] = field(default_factory=Counter)  # of the points that are done

    @property
    def done(self) -> int:
        """Number of points that were computed now, or stored before."""
        return self.outcomes.total()

    @property
    def text(self) -> str:
        """The number of finished points, and the outcomes."""
        outcomes = ", ".join(f"{number} {name}" for name, number in sorted(self.outcomes.items()))
        return f"{self.done} of {self.total} points" + f"; {outcomes}" * bool(outcomes)


def sweep_points(
    plan: Plan, store: Store, workers: Workers, *, progress: Progress = lambda line: None
) -> SweepCounts:
    """Compute every point of `plan` that `store` does not have, or has without a verdict."""
    count, missing = SweepCounts(plan.points), []
    for point in grid_points(plan):
        outcome = store.outcome_of(point.key)
        if outcome in (None, ERROR):
            missing.append(point.place)
        else:
            count.outcomes[outcome] += 1
    if not missing:
        return count
    progress(Notice(f"computing {len(missing)} of {count.total} points"))
    for key, record in study(workers, compute_point, _requests(plan, missing)):
        if isinstance(record, BaseException):
            text = f"the worker was killed several times (out of memory?): {record}"
            record = Record.without_verdict(type(record).__name__, text, plan.engine)
        store.put(key, record)
        count.ran += 1
        count.outcomes[record.outcome] += 1
        progress(count.text)
    return count


def _requests(plan: Plan, places: Iterable[int]) -> Iterator[tuple[bytes, Point]]:
    """Yield key, scene and problem of each point; of a scene that cannot be made its record."""
    last = problem = None
    for point in grid_points(plan, places):
        try:
            scene = with_values(plan.scene, point.values | {ENGINE: plan.engine})
            if last is None or last.problem != scene.problem:  # neighbours often share it
                last, problem = scene, make_problem(scene)
            yield point.key, (scene, problem)
        except MACHINE_FAILURES:  # ngspice was removed: no result of a point
            raise
        except TactionError as error:
            failed = Record.without_verdict(type(error).__name__, str(error), plan.engine)
            yield point.key, (failed, None)


def compute_point(scene: Scene | Record, problem: InverseProblem | None) -> Record:
    """Compute a point; a verification that fails gives a record, too, and a record is its own."""
    if isinstance(scene, Record):
        return scene
    engine = scene.analysis.engine
    return attempted(
        lambda: Record.of(verify(scene, problem=problem), channels=False),
        lambda error, reason: Record.without_verdict(type(error).__name__, reason, engine),
    )


def computed(
    plan: Plan,
    store: Store,
    *,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> SweepCounts:
    """Compute what `store` lacks, by processes here or a cluster."""
    try:
        with workers_at(cluster, jobs, lambda text: progress(Notice(text))) as workers:
            return sweep_points(plan, store, workers, progress=progress)
    except KeyboardInterrupt:
        stored = f"{store.count()} results are in {store.path}; the same command continues"
        raise Interrupted(stored) from None
