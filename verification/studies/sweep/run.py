"""Sweeps: every point of a grid verified, stored as it comes, and never computed twice.

Memory does not grow with the number of points: the grid is walked lazily, only a window of it is
under way, and results live in the store.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, field, replace
from queue import SimpleQueue

from netlist_gen.board.synthesis import synthesise
from netlist_gen.overrides.axes import with_values
from netlist_gen.problem.inverse_problem import InverseProblem, make_problem
from netlist_gen.scene.scene import Scene
from spice_models.errors import Complaint, InputError, NoVerdictError, TactionError
from verification.studies.running.digests import digest, own_code
from verification.studies.running.executors import Workers
from verification.studies.running.versions import own_versions
from verification.studies.sweep.plan import ENGINE, Plan, Point, Requests, simulator_of
from verification.studies.sweep.point import Job, Result, compute, failure
from verification.studies.sweep.store import ERROR, Row, Store

AHEAD = 16  # points prepared in one go: the caches that one warms serve the next


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
        Told the count after every point.

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
    run = _Run(plan, store, workers, retry_failed, Count(plan.total), progress)
    for point in Requests(plan):
        run.take(point)
    run.drain()
    return run.count


class _Run:
    """A sweep under way."""

    def __init__(
        self,
        plan: Plan,
        store: Store,
        workers: Workers,
        retry_failed: bool,
        count: Count,
        progress: Callable[[Count], None],
    ) -> None:
        self.plan, self.store, self.workers = plan, store, workers
        self.retry_failed, self.count, self.progress = retry_failed, count, progress
        self._running: dict[Future[Result], bytes] = {}
        self._ended: SimpleQueue[Future[Result]] = SimpleQueue()
        self._requests: dict[bytes, list[bytes]] = {}  # of each key that is under way
        self._problems: dict[bytes, InverseProblem] = {}

    def take(self, point: Point) -> None:
        """Find a point in the store, or start it."""
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
            self._submit(point, scene, problem, key)

    def drain(self) -> None:
        """Wait for everything that is under way."""
        while self._running:
            self._collect()

    def _known(self, key: bytes) -> bool:
        outcome = self.store.outcome_of(key)
        if outcome is None or (outcome == ERROR and self.retry_failed):
            return False
        if self.plan.keep_waveforms and outcome != ERROR and not self.store.has_waveforms(key):
            return False
        self._counted(outcome, ran=False)
        return True

    def _submit(self, point: Point, scene: Scene, problem: InverseProblem, key: bytes) -> None:
        versions = own_versions(point.engine == "ngspice")
        job = Job(scene, problem, self.plan.second_look, self.plan.keep_waveforms, versions)
        if len(self._running) >= self._window() + AHEAD:
            while len(self._running) >= self._window():
                self._collect()
        try:
            future = self.workers.executor.submit(compute, job)
        except self.workers.closed as error:
            raise self._gone() from error
        self._running[future] = key
        self._requests[key] = [point.request]
        future.add_done_callback(self._ended.put)

    def _window(self) -> int:
        try:
            return max(self.workers.window(), 1)
        except self.workers.closed as error:
            raise self._gone() from error

    def _collect(self) -> None:
        """Wait for a point and store its result."""
        future = self._ended.get()
        key = self._running.pop(future)
        requests = self._requests.pop(key)
        try:
            result = future.result()
        except self.workers.lost as error:
            text = f"the worker was killed again and again (out of memory?): {error}"
            result = failure(type(error).__name__, text, "")
        except CancelledError:
            raise self._gone() from None
        except Exception as error:  # `compute` raises nothing, so this is the way to it
            text = f"no worker can compute points ({type(error).__name__}: {error}); is the"
            raise NoVerdictError(f"{text} same taction installed there?") from error
        if result.skew:
            raise _skewed(result.skew)
        self._store(key, requests, result)

    def _gone(self) -> NoVerdictError:
        text = f"the workers are gone; {self.count.done} points are stored, the same command"
        return NoVerdictError(f"{text} goes on from there")

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


def _skewed(what: str) -> InputError:
    text = f"{what}; a sweep needs the same versions everywhere. What is stored stays"
    return InputError("--cluster", Complaint("worker", "", text))
