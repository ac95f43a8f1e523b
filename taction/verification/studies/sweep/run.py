"""Sweeps: verify every point of a grid, store each result at once, and compute no point twice.

Memory hardly grows with the number of points: the grid is generated lazily, only a few points are
being computed at a time, and results live in the store. A failed verification is a result like any
other: no exception crosses the border between processes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

from taction.netlist_gen.scene.axes import ENGINE, with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.system.errors import MACHINE_FAILURES, Interrupted, TactionError
from taction.system.progress import Notice, Progress
from taction.verification.studies.running.pool import Workers
from taction.verification.studies.running.study import Pace, attempted, study, workers_at
from taction.verification.studies.running.versions import check_version, own_version
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan, grid_points
from taction.verification.verdict.record import ERROR, Record
from taction.verification.verdict.verify import Effort, Verdict
from taction.verification.verdict.verify_together import Request, verify_together

POINT_EFFORT = Effort(details=False)


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
    """Compute every point of `plan` that `store` does not have, or has without a verdict.

    Raises
    ------
    InputError, NoVerdictError
        As `taction.sweep`; the points stored before are intact.
    OutOfDisk
        The store cannot grow.
    """
    count, pace, missing = SweepCounts(plan.points), Pace(), []
    for point in grid_points(plan, plan.order):
        outcome = store.outcome_of(point.key)
        if outcome in (None, ERROR):
            missing.append(point.place)
        else:
            count.outcomes[outcome] += 1
    if not missing:
        return count
    progress(Notice(f"computing {len(missing)} of {count.total} points"))
    compute = partial(compute_points, own_version(plan.engine == "ngspice"))
    for key, record in study(workers, compute, _requests(plan, missing), len(missing)):
        if isinstance(record, BaseException):
            text = f"the worker was killed several times (out of memory?): {record}"
            record = Record.without_verdict(type(record).__name__, text, plan.engine)
        store.put(key, record)
        count.ran += 1
        count.outcomes[record.outcome] += 1
        progress(f"{count.text}{pace.ended(count.total - count.done)}")
    return count


def _requests(plan: Plan, places: Iterable[int]) -> Iterator[tuple[bytes, Request | Record]]:
    """Yield key and request of each point; of a scene that cannot be made its record."""
    last = None
    for point in grid_points(plan, places):
        try:
            scene = with_values(plan.scene, point.values | {ENGINE: plan.engine})
            if last is None or last.scene.problem != scene.problem:  # neighbours often share it
                last = Request(scene, make_problem(scene), effort=POINT_EFFORT)
            request = Request(scene, last.problem, effort=POINT_EFFORT)
        except MACHINE_FAILURES:  # ngspice was removed: no result of a point
            raise
        except TactionError as error:
            kind = type(error).__name__
            yield point.key, Record.without_verdict(kind, str(error), plan.engine)
        else:
            yield point.key, request


def compute_points(version: str, *points: Request | Record) -> list[Record | None]:
    """Compute points; a verification that fails gives a record, too, and a record is its own.

    Of several points those are computed that the engine solves together; each other one is None,
    and needs a call of its own. `version` is that of the process that runs the sweep.

    Raises
    ------
    NoVerdictError
        This process has another version of taction or ngspice, or it can compute no point; the
        point itself may be right.
    """
    check_version(version)
    if len(points) == 1:
        return [point if isinstance(point, Record) else _computed(point) for point in points]
    requests = {k: point for k, point in enumerate(points) if isinstance(point, Request)}
    places = list(requests)
    found = {places[k]: _record(each) for k, each in verify_together(list(requests.values()))}
    return [p if isinstance(p, Record) else found.get(k) for k, p in enumerate(points)]


def _record(verdict: Verdict) -> Record:
    return Record.of(verdict, channels=False)


def _computed(request: Request) -> Record:
    engine = request.scene.analysis.engine
    return attempted(
        lambda: _record(request.verdict()),
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
    """Compute what `store` lacks, by processes here or a cluster.

    Raises
    ------
    Interrupted
        Ctrl-C; the text says what is stored.
    """
    try:
        with workers_at(cluster, jobs, lambda text: progress(Notice(text))) as workers:
            return sweep_points(plan, store, workers, progress=progress)
    except KeyboardInterrupt:
        stored = f"{store.count()} results are in {store.path}; the same command continues"
        raise Interrupted(stored) from None
