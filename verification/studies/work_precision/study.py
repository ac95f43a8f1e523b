"""Error against run time of one scene for every engine, method and tolerance or step.

`run_study` runs the ladders of `METHODS` and measures each run against references by other solvers;
`WorkPrecisionStudy.cheapest` returns the fastest setting that reaches a given error.
"""

from __future__ import annotations

import math
import statistics
import time as clock
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import SimulationError
from taction.system.results import Result
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.reference.ideal_answer import ideal_network, initial_voltages
from taction.verification.studies.running.versions import describe_machine
from taction.verification.studies.running.worker import START_UP, Worker
from taction.verification.studies.work_precision.convergence_order import Order, fit_order
from taction.verification.studies.work_precision.extent import Extent, study_extent
from taction.verification.studies.work_precision.ladders import SettingRuns, run_ladders
from taction.verification.studies.work_precision.method_runs import Task, load_integrators
from taction.verification.studies.work_precision.methods import METHODS, Method
from taction.verification.studies.work_precision.norms import NORMS, Errors
from taction.verification.studies.work_precision.run_errors import ProblemErrors, measure_runs
from taction.verification.verdict.progress import Progress

BUDGET = 30.0  # s
LADDERS = 0.7  # of the budget; the rest is for the references
LEAST = 0.25  # of the budget: for the ladders, however long a busy machine takes to start
REFERENCE_TIME = 20.0  # s for the references at least
NEVER_RUN = (
    "ngspice Gear of order 3 to 6 (maxord): not run, not stable for poles near the imaginary axis",
    "ngspice without a maximum step: not run, its steps would follow no ladder",
)
ERRORS = tuple(10.0**-k for k in range(2, 11))


@dataclass(frozen=True, slots=True)
class SettingResult:
    """The results of one setting of one method."""

    DOCUMENT = (
        *("setting = known_setting", "status", "seconds [s]", "seconds_fastest [s] = fastest"),
        *("seconds_slowest [s] = slowest", "repeats", "steps", "factorisations"),
        *("mean_step [s]", "errors", "reference", "note"),
    )

    method: Method
    setting: float
    name: str  # the setting in words
    status: str  # "done", "timeout" or "failed"
    seconds: float | None  # median of the wall times, s; the limit after a time-out
    fastest: float | None  # s
    slowest: float | None  # s
    repeats: int
    steps: int | None  # of one run
    factorisations: int | None  # of one run
    mean_step: float | None  # length of the record over its steps, s
    errors: Errors  # by norm, see `taction.verification.studies.work_precision.norms`
    reference: str
    note: str  # message of the error

    @property
    def known_setting(self) -> float | None:
        """The setting; None of a method without one."""
        return self.setting if self.method.setting else None


@dataclass(frozen=True, slots=True, eq=False)
class WorkPrecisionStudy(Result):
    """A work-precision study of one scene."""

    VIEW = "taction.verification.report.views.accuracy:view"

    scene: Scene
    points: tuple[SettingResult, ...]  # by method and setting, coarse to fine
    orders: dict[str, Order]  # of the largest error over time, by method
    problems: dict[str, ProblemErrors]  # of "board" and "ideal"
    extent: Extent  # the part of the transient that was studied
    omissions: tuple[str, ...]  # methods and settings that were not run, and why
    machine: dict[str, str | int | float | None]  # see `describe_machine`
    seconds: float  # wall time of the study

    @property
    def outcome(self) -> str:
        """``pass`` if a run of the board has a known error, else ``inconclusive``."""
        return "pass" if self.conclusive else "inconclusive"

    @property
    def conclusive(self) -> bool:
        """Whether the board was run, and the error of a run is known."""
        return self.cheapest(math.inf) is not None

    def of(self, method: Method) -> tuple[SettingResult, ...]:
        """Return the points of one method."""
        return tuple(point for point in self.points if point.method is method)

    def cheapest(
        self, error: float, norm: str = "maximum", engines: Iterable[str] | None = None
    ) -> SettingResult | None:
        """Return the fastest setting for the board whose error is at most `error`, or None."""
        accurate = [
            (point.seconds, point)
            for point in self.points
            if point.method.problem == "board"
            and (engines is None or point.method.engine in set(engines))
            and point.seconds is not None
            and (measured := point.errors.get(norm)) is not None
            and measured <= error
        ]
        return min(accurate, key=lambda pair: pair[0])[1] if accurate else None


def run_study(
    scene: Scene,
    *,
    budget: float = BUDGET,
    methods: Sequence[Method] = METHODS,
    progress: Progress = lambda stage: None,
) -> WorkPrecisionStudy:
    """Compare methods on a scene.

    Parameters
    ----------
    scene : Scene
        Its board and its ideal network are studied; its engine and its step are not used.
    budget : float
        Wall time for the study, s; it determines the part of the transient that is studied.
    methods : sequence of Method
        The methods to compare.
    progress : callable, optional
        Receives the name of each stage.

    Raises
    ------
    InputError, NoVerdictError
        The scene cannot be used, or its board has no equations.
    """
    started = clock.perf_counter()
    progress("synthesis")
    problem = make_problem(scene)
    circuit = synthesise(scene, problem)
    network = ideal_network(problem, scene)
    applicable, omissions = _applicable(methods, circuit)
    progress("time of an ngspice point")
    extent = study_extent(scene, circuit, network, applicable, LADDERS * budget)
    task = Task(circuit, extent.transient, network, initial_voltages(scene, network))
    with Worker() as worker:
        worker.call(START_UP, load_integrators)
        limit = LADDERS * budget - (clock.perf_counter() - started)
        limit = max(limit, LEAST * budget)
        entries, not_run = run_ladders(task, applicable, limit, worker, progress)
        progress("references")
        limit = max(started + budget - clock.perf_counter(), REFERENCE_TIME)
        band = scene.checks.settling_time.band
        problems = measure_runs(task, entries, band, extent.pole, worker, limit)
    points = tuple(_point(task, entry, problems[entry.method.problem]) for entry in entries)
    return WorkPrecisionStudy(
        scene=scene,
        points=points,
        orders={m.name: _order(m, points, problems[m.problem]) for m in applicable},
        problems={name: p for name, p in problems.items() if p.scale is not None},
        extent=extent,
        omissions=(*omissions, *not_run, *(o for p in problems.values() for o in p.omissions)),
        machine=describe_machine(),
        seconds=clock.perf_counter() - started,
    )


def _applicable(methods: Sequence[Method], circuit: Circuit) -> tuple[list[Method], list[str]]:
    """Return the methods that this board and this machine can run, and the omissions."""
    try:
        find_simulator()
        missing = ""
    except SimulationError as error:
        missing = str(error).splitlines()[0]
    applicable, omissions = [], list(NEVER_RUN)
    for method in methods:
        if reason := method.refuses(circuit):
            omissions.append(f"{method.name}: not run, {reason}")
        elif method.engine == "ngspice" and missing:
            omissions.append(f"{method.name}: not run, {missing}")
        else:
            applicable.append(method)
    return applicable, omissions


def _point(task: Task, entry: SettingRuns, problem: ProblemErrors) -> SettingResult:
    run, seconds = entry.run, entry.seconds
    stop = task.transient.stop if entry.method.problem == "board" else task.ideal_stop
    key = (entry.method.name, entry.setting)
    errors, reference = problem.errors.get(key, (dict.fromkeys(NORMS), ""))
    return SettingResult(
        method=entry.method,
        setting=entry.setting,
        name=entry.name,
        status=entry.status,
        seconds=statistics.median(seconds) if seconds else None,
        fastest=min(seconds, default=None),
        slowest=max(seconds, default=None),
        repeats=len(seconds),
        steps=None if run is None else run.steps,
        factorisations=None if run is None else run.factorisations,
        mean_step=stop / run.steps if run is not None and run.steps else None,
        errors=errors,
        reference=reference,
        note=entry.note,
    )


def _order(method: Method, points: Sequence[SettingResult], problem: ProblemErrors) -> Order:
    if not method.setting:
        return Order(None, None, None, (), "no step")
    ladder = [point for point in points if point.method is method]
    return fit_order(
        [point.mean_step for point in ladder],
        [point.errors["maximum"] for point in ladder],
        problem.floor["maximum"] or 0.0,
        [f"{point.setting:g}" for point in ladder],
    )
