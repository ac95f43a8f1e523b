"""Sweeps: every point of a grid verified, stored as it comes, and never computed twice.

Memory does not grow with the number of points: the grid is walked lazily, only a window of it is
under way, and results live in the store.
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
from verification.studies.sweep.plan import ENGINE, Plan, Point, Requests, simulator_of
from verification.studies.sweep.point import Job, Result, compute, failure
from verification.studies.sweep.store import ERROR, Row, Store


@dataclass(slots=True)
class Count:
    """How far a sweep has come.

    Attributes
    ----------
    total, done : int
        Points, of all and so far; those that were stored before count as done.
    ran : int
        Points that were computed now.
    outcomes : Counter
        Of everything done.
    """

    total: int
    done: int = 0
    ran: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)

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
    progress: Callable[[Count], None] = lambda count: None,
) -> Count:
    """Compute every point of `plan` that `store` does not have.

    Parameters
    ----------
    retry_failed : bool
        Compute those again that reached no verdict.
    progress : callable, optional
        Gets the count after every point.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        ngspice is asked for and there is none that will do.
    InputError
        A worker has other versions of taction or ngspice; or the store cannot be used.
    NoVerdictError
        The cluster is gone.
    OutOfDisk
        The store cannot grow. Whatever is raised, what was stored before is intact.
    """
    run = _Sweep(plan, store, retry_failed, Count(plan.total), progress)
    for key, found in collected(workers, compute, run.missing()):
        run.keep(key, found)
    return run.count


class _Sweep:
    """A sweep under way."""

    def __init__(
        self,
        plan: Plan,
        store: Store,
        retry_failed: bool,
        count: Count,
        progress: Callable[[Count], None],
    ) -> None:
        self.plan, self.store = plan, store
        self.retry_failed, self.count, self.progress = retry_failed, count, progress
        self._requests: dict[bytes, list[bytes]] = {}  # of each key that is under way
        self._problems: dict[bytes, InverseProblem] = {}

    def missing(self) -> Iterator[tuple[bytes, tuple[Job]]]:
        """Yield key and job of every point that has to be computed, and count the others."""
        for point in Requests(self.plan):
            yield from self._take(point)

    def keep(self, key: bytes, found: Result | BaseException) -> None:
        """Store what came out of a job."""
        if isinstance(found, BaseException):
            text = f"the worker was killed again and again (out of memory?): {found}"
            found = failure(type(found).__name__, text, "")
        self._store(key, self._requests.pop(key), found)

    def _take(self, point: Point) -> Iterator[tuple[bytes, tuple[Job]]]:
        """Find a point in the store, or say how it is computed."""
        key = self.store.key_of(point.request)
        if key is not None and self._known(key):
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
        elif self._known(key):
            self.store.link(point.request, key)
        else:
            self._requests[key] = [point.request]
            versions = own_versions(point.engine == "ngspice")
            plan = self.plan
            yield key, (Job(scene, problem, plan.second_look, plan.keep_waveforms, versions),)

    def _known(self, key: bytes) -> bool:
        outcome = self.store.outcome_of(key)
        if outcome is None or (outcome == ERROR and self.retry_failed):
            return False
        if self.plan.keep_waveforms and outcome != ERROR and not self.store.has_waveforms(key):
            return False
        self._counted(outcome, ran=False)
        return True

    def _store(self, key: bytes, requests: list[bytes], result: Result) -> None:
        row = Row(key, result.outcome, result.record, result.waveforms)
        self.store.put(row, requests[0])
        for other in requests[1:]:
            self.store.link(other, key)
            self.count.add(result.outcome, ran=False)
        self._counted(result.outcome, ran=True)

    def _counted(self, outcome: str, *, ran: bool) -> None:
        self.count.add(outcome, ran=ran)
        self.progress(self.count)

    def _problem(self, scene: Scene) -> InverseProblem:
        """Make the problem of `scene`, or take the last one where it is the same."""
        key = digest(scene.problem)
        if key not in self._problems:
            self._problems = {key: make_problem(scene)}
        return self._problems[key]

    def _key(self, scene: Scene, problem: InverseProblem, engine: str) -> bytes:
        """Digest everything that a result follows from, and nothing else."""
        circuit = replace(synthesise(scene, problem), name="", omissions=())
        analysis = scene.analysis.model_dump(exclude={"engine", "timeout"})
        simulator = simulator_of(engine)
        known = (problem.matrix, problem.strain, scene.checks, analysis, self.plan.second_look)
        return digest(own_code(), circuit, *known, engine, simulator)
