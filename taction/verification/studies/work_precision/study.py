"""Error against run time of one scene for every engine, method and tolerance or step.

`accuracy` runs the settings of `METHODS`, coarse to fine, and compares each with the exact
solution, or one with a far smaller tolerance.
"""

from __future__ import annotations

import math
import statistics
import time as clock
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import EngineError, SimulationError
from taction.system.progress import Notice, Progress
from taction.system.quantities import show
from taction.system.results import Result
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.pool import FAILURES, Worker
from taction.verification.studies.running.versions import describe_machine
from taction.verification.studies.work_precision.methods import (
    BASE_POINTS,
    EXACT,
    METHODS,
    Method,
    MethodRun,
    MethodTask,
    solutions,
)
from taction.verification.verdict.transient_plan import even_transient

PERIODS = 30.0  # of ringing that are studied
REPEATS = 3
LEAST_TIME = 20.0  # s for a run and for a reference at least, whatever is left of the budget
MAX_ERROR = 0.1  # a larger error is not asymptotic
ABOVE_FLOOR = 10.0  # least error of a run, in errors of the reference
ERRORS = tuple(10.0**-k for k in range(2, 11))


def convergence(points: Sequence[SettingResult], floor: float) -> float | None:
    """Return the order: the median slope of ln error over ln step between neighbours of a ladder.

    Errors above `MAX_ERROR`, or below `ABOVE_FLOOR` times the reference's own, `floor`, do not
    count.
    """
    usable = [
        (math.log(point.mean_step), math.log(point.error))
        for point in points
        if point.mean_step and point.error and ABOVE_FLOOR * floor <= point.error <= MAX_ERROR
    ]
    slopes = [(d - b) / (c - a) for (a, b), (c, d) in pairwise(usable) if a != c]
    return statistics.median(slopes) if len(slopes) > 1 else None


@dataclass(frozen=True, slots=True)
class SettingResult:
    """The results of one setting of one method."""

    DOCUMENT = (
        *("setting = known_setting", "status", "seconds [s]", "steps", "factorisations"),
        *("mean_step [s]", "error", "reference", "note"),
    )

    method: Method
    setting: float
    status: str = "done"  # or "timeout" or "failed"
    seconds: float | None = None  # median of the wall times, s; of a time-out its limit
    steps: int | None = None  # of one run
    factorisations: int | None = None  # of one run
    mean_step: float | None = None  # length of the record over its steps, s
    error: float | None = None  # largest over time and channels, over the step amplitude
    reference: str = ""
    note: str = ""  # message of the error

    @property
    def known_setting(self) -> float | None:
        """The setting; None of a method without one."""
        return self.setting if self.method.setting else None

    @property
    def name(self) -> str:
        """The setting in words."""
        return f"{self.setting:g} {self.method.setting}" if self.method.setting else "-"


@dataclass(frozen=True, slots=True, eq=False)
class Ladder:
    """A method with the results of its settings, and its order of convergence."""

    DOCUMENT = (
        *("name = method.name", "engine = method.engine", "setting = method.setting"),
        *("order", "order_theory = method.order"),
        *("order_theory_says = method.theory", "points"),
    )

    method: Method
    order: float | None
    points: tuple[SettingResult, ...]


@dataclass(frozen=True, slots=True, eq=False)
class WorkPrecisionStudy(Result):
    """A work-precision study of one scene."""

    VIEW = "taction.verification.report.views.evidence_view:accuracy_view"
    DOCUMENT = (
        *("scene = scene.name", "file = scene.file", "stop [s] = transient.stop"),
        *("stretch", "period [s]", "references", "reference_error = floor"),
        *("step_amplitude [V] = amplitude", "methods = ladders", "omissions"),
        *("machine", "seconds [s]"),
    )

    scene: Scene
    points: tuple[SettingResult, ...]  # by method and setting, coarse to fine
    references: tuple[str, ...]  # their names, the one that runs are compared with first
    # Largest difference of the two over the step amplitude; None where one failed.
    floor: float | None
    amplitude: float  # step amplitude, V: the largest distance of an output from its start
    transient: Transient  # the part of the transient that was studied
    period: float  # of the fastest ringing, or 2 pi / |p| of the fastest mode, s
    omissions: tuple[str, ...]  # methods and settings that were not run, and why
    machine: dict[str, str | int | float | None]  # see `describe_machine`
    seconds: float  # wall time of the study

    @property
    def stretch(self) -> str:
        """The studied part of the transient in words."""
        stop = self.transient.stop
        return f"the first {show(stop, 's')}, {stop / self.period:.3g} periods of the fastest mode"

    @property
    def outcome(self) -> str:
        """``pass`` if a run has a known error, else ``inconclusive``."""
        return "inconclusive" if self.cheapest(math.inf) is None else "pass"

    @property
    def ladders(self) -> tuple[Ladder, ...]:
        """The methods with their results and their orders."""
        methods = dict.fromkeys(point.method for point in self.points)
        return tuple(Ladder(each, self.order(each), self.of(each)) for each in methods)

    def of(self, method: Method) -> tuple[SettingResult, ...]:
        """Return the points of one method."""
        return tuple(point for point in self.points if point.method is method)

    def order(self, method: Method) -> float | None:
        """Return the order of convergence of one method; None of a method without a step."""
        return convergence(self.of(method), self.floor or 0.0) if method.setting else None

    def cheapest(self, error: float, engines: Iterable[str] | None = None) -> SettingResult | None:
        """Return the fastest setting whose error is at most `error`, or None."""
        accurate = [
            (point.seconds, point)
            for point in self.points
            if (engines is None or point.method.engine in engines)
            and point.seconds is not None
            and point.error is not None
            and point.error <= error
        ]
        return min(accurate, key=lambda pair: pair[0])[1] if accurate else None


def accuracy(
    scene: str | Path | Scene, *, budget: float = 30.0, progress: Progress = lambda stage: None
) -> WorkPrecisionStudy:
    """Compare the error and the run time of every engine, method and setting on SCENE.

    Parameters
    ----------
    scene : path or Scene
        The board.
    budget : float
        Wall time for the runs, s, shared by the methods; finer settings are left out then.
    progress : callable, optional
        Receives the name of each stage, with what is left of the budget.

    Returns
    -------
    WorkPrecisionStudy
        Every run with its error and its time.

    Raises
    ------
    InputError
        The scene cannot be used.
    EngineError
        The step moves no output of the board.

    Examples
    --------
    >>> import taction
    >>> study = taction.accuracy("scenes/tuned-breadboard.toml", budget=0.5)
    >>> study.scene.name, len(study.points) > 0
    ('tuned-breadboard', True)
    """
    started, scene = clock.perf_counter(), read_scene(scene)
    circuit = synthesise(scene, make_problem(scene))
    scales = time_scales(circuit, initial=scene.analysis.initial)
    period = BASE_POINTS * scales.max_step_for(BASE_POINTS)
    stop = PERIODS * period
    if scene.analysis.stop != "auto":
        stop = min(stop, scene.analysis.stop)
    transient = even_transient(scene, scales, BASE_POINTS, stop)
    task, left_out = MethodTask(circuit, transient), list[str]()
    runs, solved = list[tuple[SettingResult, MethodRun | None]](), dict[str, Floats]()
    usable, end = list(_applicable(task, left_out)), started + budget
    with Worker() as worker:
        for k, method in enumerate(usable):
            left = max(end - clock.perf_counter(), 0.0)
            progress(f"{method.name}, {left:.0f} s left")
            runs += _ladder(worker, task, method, left / (len(usable) - k), left_out)
        progress("references")
        limit = max(end - clock.perf_counter(), LEAST_TIME)
        time = np.unique(np.concatenate([[0.0], *(run.time for _, run in runs if run)]))
        for name, solve in solutions(task).items() if len(time) > 1 else ():
            try:
                solved[name] = worker.call(limit, solve, task, times=time).u
            except (TimeoutError, *FAILURES) as error:
                left_out.append(f"reference, {name}: {error}")
    floor, amplitude = None, math.nan
    if solved:
        first, *others = solved.values()
        amplitude = float(np.abs(first - first[0]).max())
        if not amplitude:
            raise EngineError("the step moves no output of this board: nothing to study")
        floor = float(np.abs(others[0] - first).max() / amplitude) if others else None

    def compared(point: SettingResult, run: MethodRun | None) -> SettingResult:
        """Return a setting with its error beside the first solution of another method."""
        name = next((name for name in solved if name != point.method.name), None)
        if run is None or name is None:
            return point
        u = solved[name][np.searchsorted(time, run.time)]
        return replace(point, error=float(np.abs(run.u - u).max() / amplitude), reference=name)

    made = WorkPrecisionStudy(
        scene,
        tuple(compared(*pair) for pair in runs),
        tuple(solved),
        floor,
        amplitude,
        transient,
        period,
        tuple(left_out),
        describe_machine(),
        clock.perf_counter() - started,
    )
    if made.outcome != "pass":
        progress(Notice("no run has a known error; give a larger --budget"))
    return made


def _applicable(task: MethodTask, left_out: list[str]) -> Iterator[Method]:
    """Yield the methods that this board and this machine can run; `left_out` gets the others."""
    missing = ""
    try:
        find_simulator()
    except SimulationError as error:
        missing = str(error).splitlines()[0]
    large = "too many unknowns for dense matrices"
    inexact = "" if task.is_exact else large if task.circuit.is_linear else "it is not linear"
    for method in METHODS:
        reason = missing if method.engine == "ngspice" else inexact * (method.name == EXACT)
        if reason:
            left_out.append(f"{method.name}: not run, {reason}")
        else:
            yield method


def _ladder(
    worker: Worker, task: MethodTask, method: Method, seconds: float, left_out: list[str]
) -> Iterator[tuple[SettingResult, MethodRun | None]]:
    """Yield the settings of a method and their last runs, coarse to fine, for some `seconds`."""
    end, stop = clock.perf_counter() + seconds, task.transient.stop
    for place, setting in enumerate(method.ladder):
        point, times, run = SettingResult(method, setting), list[float](), None
        if place and clock.perf_counter() > end:
            left_out.append(f"{method.name}: not run from {point.name} on, no time is left")
            return
        limit = max(end - clock.perf_counter(), LEAST_TIME)
        try:
            while len(times) < REPEATS and (not times or clock.perf_counter() + times[0] < end):
                run = worker.call(limit, method.run, task, setting)
                times.append(run.seconds)
        except TimeoutError as error:
            if run is None:
                yield replace(point, status="timeout", seconds=limit, note=str(error)), None
                return
        except FAILURES as error:
            run, point = None, replace(point, status="failed", note=_words(error))
        if run is None:
            yield point, None
            continue
        point = replace(
            point,
            seconds=statistics.median(times),
            steps=run.steps,
            factorisations=run.factorisations,
            mean_step=stop / run.steps if run.steps else None,
        )
        yield point, run.thinned


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]
