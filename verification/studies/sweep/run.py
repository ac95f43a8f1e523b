"""Sweeps: verify every point of a grid, store each result at once, and compute no point twice.

Memory does not grow with the number of points: the grid is generated lazily, only a few points are
being computed at a time, and results live in the store.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from netlist_gen.board.synthesis import synthesise
from netlist_gen.overrides.axes import with_values
from netlist_gen.problem.inverse_problem import InverseProblem, make_problem
from netlist_gen.scene.scene import Scene
from spice_models.errors import TactionError
from verification.studies.running.collecting import collected
from verification.studies.running.digests import digest, own_code
from verification.studies.running.executors import Workers
from verification.studies.running.versions import own_versions
from verification.studies.sweep.plan import ENGINE, GridPoint, Plan, Requests, simulator_of
from verification.studies.sweep.point import Job, compute, failure
from verification.studies.sweep.store import ERROR, Store, StoredResult


@dataclass(slots=True)
class SweepCounts:
    """How many points a sweep has and how they ended."""

    total: int
    done: int = 0  # computed now, or stored before
    ran: int = 0  # computed now
    outcomes: Counter[str] = field(default_factory=Counter)  # of the points that are done

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
) -> SweepCounts:
    """Compute every point of `plan` that `store` does not have.

    Parameters
    ----------
    retry_failed : bool
        Compute points again that reached no verdict.
    progress : callable, optional
        Receives the counts after every point.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        The plan needs ngspice, and no ngspice was found or the ngspice is too old.
    InputError
        A worker has other versions of taction or ngspice; or the store cannot be used.
    NoVerdictError
        The cluster does not answer any more.
    OutOfDisk
        The store cannot grow. After any of these errors the points stored before are intact.
    """
    run = _Sweep(plan, store, retry_failed, progress)
    for key, result in collected(workers, compute, run.missing()):
        run.keep(key, result)
    return run.count


class _Sweep:
    """A sweep that is running."""

    def __init__(
        self,
        plan: Plan,
        store: Store,
        retry_failed: bool,
        progress: Callable[[SweepCounts], None],
    ) -> None:
        self.plan, self.store, self.retry_failed = plan, store, retry_failed
        self.count, self.progress = SweepCounts(plan.total), progress
        self._requests: dict[bytes, list[bytes]] = {}  # by the key of a point that is computed now
        self._problems: dict[bytes, InverseProblem] = {}

    def missing(self) -> Iterator[tuple[bytes, tuple[Job]]]:
        """Yield key and job of every point that has to be computed; count the stored points."""
        for point in Requests(self.plan):
            yield from self._missing(point)

    def keep(self, key: bytes, result: StoredResult | BaseException) -> None:
        """Store the result of a job."""
        if isinstance(result, BaseException):
            text = f"the worker was killed several times (out of memory?): {result}"
            result = failure(type(result).__name__, text, "")
        self._store(key, self._requests.pop(key), result)

    def _missing(self, point: GridPoint) -> Iterator[tuple[bytes, tuple[Job]]]:
        """Yield key and job of a point unless the store or a running job has its result."""
        key = self.store.key_of(point.request)
        if key is not None and self._is_stored(key):
            return
        try:
            scene = with_values(self.plan.scene, point.values | {ENGINE: point.engine})
            problem = self._problem(scene)
            key = self._key(scene, problem, point.engine)
        except TactionError as error:
            result = failure(type(error).__name__, str(error), point.engine)
            self._store(point.request, [point.request], result)
            return
        if key in self._requests:
            self._requests[key].append(point.request)
        elif self._is_stored(key):
            self.store.link(point.request, key)
        else:
            self._requests[key] = [point.request]
            versions = own_versions(point.engine == "ngspice")
            plan = self.plan
            yield key, (Job(scene, problem, plan.second_look, plan.keep_waveforms, versions),)

    def _is_stored(self, key: bytes) -> bool:
        """Whether a stored result can be used; count it if so."""
        outcome = self.store.outcome_of(key)
        if outcome is None or (outcome == ERROR and self.retry_failed):
            return False
        if self.plan.keep_waveforms and outcome != ERROR and not self.store.has_waveforms(key):
            return False
        self._count(outcome, ran=False)
        return True

    def _store(self, key: bytes, requests: list[bytes], result: StoredResult) -> None:
        self.store.put(key, result, requests[0])
        for other in requests[1:]:
            self.store.link(other, key)
            self.count.add(result.outcome, ran=False)
        self._count(result.outcome, ran=True)

    def _count(self, outcome: str, *, ran: bool) -> None:
        self.count.add(outcome, ran=ran)
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
        inputs = (problem.matrix, problem.strain, scene.checks, analysis, self.plan.second_look)
        return digest(own_code(), circuit, *inputs, engine, simulator_of(engine))
