"""Sweeps: verify every point of a grid, store each result at once, and compute no point twice.

Memory hardly grows with the number of points: the grid is generated lazily, only a few points are
being computed at a time, and results live in the store.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

from taction.netlist_gen.scene.axes import ENGINE, with_values
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.system.errors import MACHINE_FAILURES, Interrupted, TactionError
from taction.system.progress import Notice, Progress
from taction.verification.studies.running.collecting import Pace, collected_together, together
from taction.verification.studies.running.executors import workers_at
from taction.verification.studies.running.versions import digest, own_version
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan, grid_points
from taction.verification.studies.sweep.point import compute
from taction.verification.verdict.record import ERROR, Record
from taction.verification.verdict.verify import Effort
from taction.verification.verdict.verify_together import Request

POINT_EFFORT = Effort(details=False)


@dataclass(slots=True)
class SweepCounts:
    """How many points a sweep has, and how they ended."""

    total: int
    done: int = 0  # computed now, or stored before
    ran: int = 0  # computed now
    outcomes: Counter[str] = field(default_factory=Counter)  # of the points that are done

    @property
    def text(self) -> str:
        """The number of finished points, and the outcomes."""
        outcomes = ", ".join(f"{number} {name}" for name, number in sorted(self.outcomes.items()))
        return f"{self.done} of {self.total} points" + f"; {outcomes}" * bool(outcomes)

    def add(self, outcome: str, *, ran: bool) -> None:
        """Count one point."""
        self.done += 1
        self.ran += ran
        self.outcomes[outcome] += 1


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
    count, pace = SweepCounts(plan.points), Pace()
    missing = []
    for point in grid_points(plan, plan.order):
        outcome = store.outcome_of(point.key)
        if outcome in (None, ERROR):
            missing.append(point.place)
        else:
            count.add(outcome, ran=False)
    if not missing:
        return count
    progress(Notice(f"computing {len(missing)} of {count.total} points"))
    jobs, size = _jobs(plan, missing), together(len(missing), workers)
    computing = partial(compute, own_version(plan.engine == "ngspice"))
    for key, result in collected_together(workers, computing, jobs, size):
        if isinstance(result, BaseException):
            text = f"the worker was killed several times (out of memory?): {result}"
            result = Record.without_verdict(type(result).__name__, text, plan.engine)
        store.put(key, result)
        count.add(result.outcome, ran=True)
        progress(f"{count.text}{pace.ended(count.total - count.done)}")
    return count


def _jobs(plan: Plan, places: Iterable[int]) -> Iterator[tuple[bytes, Request | Record]]:
    """Yield key and job of each point; of a scene that cannot be made its record."""
    problems: dict[bytes, InverseProblem] = {}
    for point in grid_points(plan, places):
        try:
            scene = with_values(plan.scene, point.values | {ENGINE: plan.engine})
            wanted = digest(scene.problem)
            if wanted not in problems:  # neighbours often share the problem
                problems = {wanted: make_problem(scene)}
        except MACHINE_FAILURES:  # ngspice was removed: no result of a point
            raise
        except TactionError as error:
            kind = type(error).__name__
            yield point.key, Record.without_verdict(kind, str(error), plan.engine)
        else:
            yield point.key, Request(scene, problems[wanted], effort=POINT_EFFORT)


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
