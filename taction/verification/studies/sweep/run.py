"""Sweeps: verify every point of a grid, store each result at once, and compute no point twice.

Memory hardly grows with the number of points: the grid is generated lazily, only a few points are
being computed at a time, and results live in the store. The forecast of the cost takes some 100
bytes a point.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import ENGINE, with_values
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Bools
from taction.system.errors import MACHINE_FAILURES, Interrupted, TactionError
from taction.system.progress import Notice, Progress, duration
from taction.verification.studies.running.collecting import collected_together, together
from taction.verification.studies.running.versions import digest, own_code, own_versions
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.store import Store, StoredResult
from taction.verification.studies.sweep.forecast import (
    TINY,
    CostForecast,
    RemainingTime,
    announcement,
    forecast_costs,
    wall_time,
)
from taction.verification.studies.sweep.hybrid import confirmed_points
from taction.verification.studies.sweep.plan import GridPoint, Plan, Requests, simulator_of
from taction.verification.studies.sweep.point import PointJob, compute, failure
from taction.verification.verdict.record import ERROR

LOST = 4.0  # s: estimated time of a call of ngspice points, which a stop loses


@dataclass(slots=True)
class SweepCounts:
    """How many points a sweep has, how they ended, and how long the sweep will take."""

    total: int
    done: int = 0  # computed now, or stored before
    ran: int = 0  # computed now
    outcomes: Counter[str] = field(default_factory=Counter)  # of the points that are done
    estimate: float | None = None  # s for the whole sweep, before it started
    time: RemainingTime | None = None

    @property
    def remaining(self) -> float | None:
        """Estimated time until all points are computed, s; None if all are stored."""
        return None if self.time is None else self.time.seconds()

    @property
    def text(self) -> str:
        """The number of finished points, the remaining time, and the outcomes."""
        left = self.remaining if self.done < self.total else None
        text = f"{self.done} of {self.total} points"
        text = text if left is None else f"{text}, about {duration(left)} left"
        outcomes = ", ".join(f"{number} {name}" for name, number in sorted(self.outcomes.items()))
        return f"{text}; {outcomes}" if outcomes else text

    def add(self, outcome: str, *, ran: bool) -> None:
        """Count one point."""
        self.done += 1
        self.ran += ran
        self.outcomes[outcome] += 1


def sweep(
    plan: Plan,
    store: Store,
    workers: Workers,
    *,
    retry_failed: bool = False,
    progress: Callable[[SweepCounts], None] = lambda count: None,
    announce: Callable[[str], None] = lambda text: None,
) -> SweepCounts:
    """Compute every point of `plan` that `store` does not have.

    Parameters
    ----------
    retry_failed : bool
        Compute points again that reached no verdict.
    progress : callable, optional
        Receives the counts after every point.
    announce : callable, optional
        Receives a line with the estimated time before the first point is computed.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        The plan needs ngspice, and no ngspice was found or the ngspice is too old.
    InputError
        The store cannot be used.
    NoVerdictError
        The cluster does not answer any more, or has other versions of taction or ngspice.
    OutOfDisk
        The store cannot grow. After any of these errors the points stored before are intact.
    """
    run = _Sweep(plan, store, workers, retry_failed, progress, announce)
    if plan.hybrid:
        run.compute(run.missing(("statespace",)))
        run.confirm()
    else:
        run.compute(run.missing(plan.engines))
    return run.count


class _Sweep:
    """A sweep that is running."""

    def __init__(
        self,
        plan: Plan,
        store: Store,
        workers: Workers,
        retry_failed: bool,
        progress: Callable[[SweepCounts], None],
        announce: Callable[[str], None],
    ) -> None:
        self.plan, self.store, self.workers = plan, store, workers
        self.retry_failed, self.progress, self.announce = retry_failed, progress, announce
        self.count = SweepCounts(plan.total)
        self._costs: CostForecast | None = None
        self._points: dict[bytes, list[GridPoint]] = {}  # by the key of a point in a worker
        self._named: set[bytes] = set()  # keys of damaged results that were announced
        self._problems: dict[bytes, InverseProblem] = {}

    def missing(self, engines: tuple[str, ...], among: Bools | None = None) -> dict[str, Bools]:
        """Mark the points that have to be computed, (P,), by engine; count the stored points."""
        every = np.ones(self.plan.points, dtype=np.bool_) if among is None else among
        missing = {engine: every.copy() for engine in engines}
        if self.store.count():
            for point in Requests(self.plan, engines):
                if every[point.place] and self._is_known(point):
                    missing[point.engine][point.place] = False
        return missing

    def compute(self, missing: dict[str, Bools]) -> None:
        """Compute the points `missing`, by engine, in the order of the plan."""
        if not any(places.any() for places in missing.values()):
            return
        self._forecast(missing)
        requests = Requests(self.plan, tuple(missing), self.plan.order)
        points = (point for point in requests if missing[point.engine][point.place])
        self._run(points, self._size(missing))

    def confirm(self) -> None:
        """Compute the points of a hybrid sweep that ngspice confirms, the dearest first."""
        chosen = np.zeros(self.plan.points, dtype=np.bool_)
        chosen[list(confirmed_points(self.plan, self.store))] = True
        self.count.total += int(chosen.sum())
        missing = self.missing(("ngspice",), chosen)
        if not missing["ngspice"].any():
            return
        costs = self._forecast(missing).seconds["ngspice"]
        requests = Requests(self.plan, ("ngspice",))
        points = [point for point in requests if missing["ngspice"][point.place]]
        self._run(sorted(points, key=lambda point: -costs[point.place]), self._size(missing))

    def _forecast(self, missing: dict[str, Bools]) -> CostForecast:
        """Estimate the time for the `missing` points; announce it before the first of them."""
        if self.count.time is not None and self._costs is not None:
            for engine, places in missing.items():
                self.count.time.replace(engine, places)
            return self._costs
        self._costs = costs = forecast_costs(self.plan)
        left = missing
        if self.plan.hybrid and "ngspice" not in missing:
            left = missing | {"ngspice": costs.confirmed(self.plan)}
        self.count.time = RemainingTime(costs, left, self.workers.processes)
        self.count.estimate = wall_time(costs, left, self.workers)
        self.announce(announcement(self.plan, costs, left, self.count.done, self.workers))
        return costs

    def _run(self, points: Iterable[GridPoint], size: int) -> None:
        jobs = (call for point in points for call in self._calls(point))
        for key, result in collected_together(self.workers, compute, jobs, size):
            if isinstance(result, BaseException):
                text = f"the worker was killed several times (out of memory?): {result}"
                result = failure(result, text, "")
            self._store(key, self._points.pop(key), result)

    def _size(self, missing: dict[str, Bools]) -> int:
        """Return how many points one call computes: a stop loses a few seconds of ngspice."""
        size = together(self.count.total - self.count.done, self.workers)
        if self._costs is not None and (places := missing.get("ngspice")) is not None:
            seconds = float(self._costs.seconds["ngspice"][places].sum())
            size = min(size, int(LOST * int(places.sum()) / max(seconds, TINY)))
        return max(size, 1)

    def _calls(self, point: GridPoint) -> Iterator[tuple[bytes, PointJob]]:
        """Yield key and job of a point unless the store or a running job has its result."""
        if self._is_known(point):
            return
        try:
            scene = with_values(self.plan.scene, point.values | {ENGINE: point.engine})
            problem = self._problem(scene)
            key = self._key(scene, problem, point.engine)
        except MACHINE_FAILURES:  # ngspice was removed: no result of a point
            raise
        except TactionError as error:
            result = failure(error, str(error), point.engine)
            self._store(point.request, [point], result)
            return
        if key in self._points:
            self._points[key].append(point)
        elif self._is_stored(key, point):
            self.store.link(point.request, key)
        else:
            self._points[key] = [point]
            if self.count.time is not None:
                self.count.time.submit(point.engine, point.place)
            versions = own_versions(point.engine == "ngspice")
            yield key, PointJob(scene, problem, self.plan.keep_waveforms, versions)

    def _is_known(self, point: GridPoint) -> bool:
        """Whether the store has a result for the request of a point; count the point if so."""
        key = self.store.key_of(point.request)
        return key is not None and self._is_stored(key, point)

    def _is_stored(self, key: bytes, point: GridPoint) -> bool:
        """Whether a stored result can be used for a point; count the point if so."""
        outcome = self.store.outcome_of(key)
        if outcome is None and key in self.store.damaged - self._named:
            self._named.add(key)
            names = {axis.key.path: axis.name for axis in self.plan.axes}
            values = ", ".join(f"{names[path]} = {each}" for path, each in point.values.items())
            self.announce(f"the stored result at {values} is damaged and is computed again")
        if outcome is None or (outcome == ERROR and self.retry_failed):
            return False
        if self.plan.keep_waveforms and outcome != ERROR and not self.store.has_waveforms(key):
            return False
        self._count(point, outcome, ran=False)
        return True

    def _store(self, key: bytes, points: list[GridPoint], result: StoredResult) -> None:
        self.store.put(key, result, points[0].request)
        for other in points[1:]:
            self.store.link(other.request, key)
            self._count(other, result.outcome, ran=False)
        self._count(points[0], result.outcome, ran=True)

    def _count(self, point: GridPoint, outcome: str, *, ran: bool) -> None:
        self.count.add(outcome, ran=ran)
        if self.count.time is not None:
            self.count.time.finish(point.engine, point.place)
        self.progress(self.count)

    def _problem(self, scene: Scene) -> InverseProblem:
        """Make the problem of `scene`, or take the last problem where it is the same."""
        key = digest(scene.problem)
        if key not in self._problems:
            self._problems = {key: make_problem(scene)}
        return self._problems[key]

    def _key(self, scene: Scene, problem: InverseProblem, engine: str) -> bytes:
        """Return the digest of everything that a result depends on, and of nothing else."""
        circuit = replace(synthesise(scene, problem), name="", omissions=())
        analysis = scene.analysis.model_dump(exclude={"engine", "timeout"})
        inputs = (problem.matrix, problem.strain, scene.checks, analysis)
        return digest(own_code(), circuit, *inputs, engine, simulator_of(engine))


def computed(
    plan: Plan,
    store: Store,
    *,
    retry_failed: bool = False,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> SweepCounts:
    """Compute what `store` lacks; after Ctrl-C the stored results stay.

    Raises
    ------
    Interrupted
        Ctrl-C; the text says what is stored.
    """
    from taction.verification.studies.running.executors import workers_at

    def notice(text: str) -> None:
        progress(Notice(text))

    try:
        with workers_at(cluster, jobs, notice) as workers:
            return sweep(
                plan,
                store,
                workers,
                retry_failed=retry_failed,
                progress=lambda count: progress(count.text),
                announce=notice,
            )
    except KeyboardInterrupt:
        stored = f"{store.count()} results are in {store.path}; the same command continues"
        raise Interrupted(stored) from None
