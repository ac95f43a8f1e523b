"""Error against run time of one scene for every engine, method and tolerance or step.

`accuracy` runs the settings of `METHODS`, coarse to fine, and compares each with a reference;
`WorkPrecisionStudy.cheapest` returns the fastest setting that reaches a given error.
"""

from __future__ import annotations

import math
import statistics
import time as clock
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import EngineError, SimulationError
from taction.system.progress import Notice, Progress, duration
from taction.system.quantities import show
from taction.system.results import Result
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.reference.ideal_answer import ideal_network, initial_voltages
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.versions import describe_machine
from taction.verification.studies.running.worker import FAILURES, START_UP, Worker
from taction.verification.studies.work_precision.methods import (
    BASE_POINTS,
    METHODS,
    Method,
    MethodRun,
    MethodTask,
    load_integrators,
)
from taction.verification.studies.work_precision.reference import References, Solve
from taction.verification.verdict.transient_plan import (
    AFTER_SETTLING,
    FEWEST_PERIODS,
    REMAINDER,
    even_transient,
)

PERIODS = 30.0  # of ringing, at most
REPEATS = 3
SHARE = 0.5  # of the remaining time that one run may take
LEAST_TIME = 20.0  # s: counted as left, so that the coarsest settings have time
REFERENCE_TIME = 20.0  # s for a reference at least
MAX_ERROR = 0.1  # a larger error is not asymptotic
ABOVE_FLOOR = 10.0  # least error of a run, in errors of the reference
SCATTER = 0.12  # rms deviation of ln(error) from a straight line, over its slope
MIN_RUNS = 3  # on a straight line
NEVER_RUN = (
    "ngspice Gear of order 3 to 6 (maxord): not run, not stable for poles near the imaginary axis",
    "ngspice without a maximum step: not run, its steps would follow no ladder",
)
ERRORS = tuple(10.0**-k for k in range(2, 11))


@dataclass(frozen=True, slots=True)
class Order:
    """A fitted order of convergence, ``error = constant * step^value``; None without an order."""

    value: float | None = None
    sigma: float | None = None  # standard uncertainty of `value`
    constant: float | None = None  # error at a step of 1 s
    points: tuple[int, ...] = ()  # places in the ladder that the fit used


def fit_order(steps: Sequence[float | None], errors: Sequence[float | None], floor: float) -> Order:
    """Fit a straight line to ``ln error`` over ``ln step`` where the ladder is asymptotic.

    Runs with an error above `MAX_ERROR` or below `ABOVE_FLOOR` times `floor` are left out, then the
    coarsest, one by one, until the others are near a straight line (`SCATTER`).

    Parameters
    ----------
    steps : sequence of float or None
        Mean step of each run, s; coarse to fine. None where there is no run.
    errors : sequence of float or None
        Error of each run; None where it is unknown.
    floor : float
        Error of the reference.
    """
    usable = [
        place
        for place, (step, error) in enumerate(zip(steps, errors, strict=True))
        if step and error and ABOVE_FLOOR * floor <= error <= MAX_ERROR
    ]
    x = np.log([float(steps[k] or 1.0) for k in usable])
    y = np.log([float(errors[k] or 1.0) for k in usable])
    for first in range(len(usable) - MIN_RUNS + 1):
        line = _line(x[first:], y[first:])
        if line is not None:
            return Order(*line, tuple(usable[first:]))
    return Order()


def _line(x: Floats, y: Floats) -> tuple[float, float, float] | None:
    """Return slope, uncertainty and constant; None if the points are not on a line."""
    spread = x - x.mean()
    width = float(spread @ spread)
    if width <= 0.0:
        return None
    slope = float(spread @ y) / width
    residual = y - y.mean() - slope * spread
    scatter = float(np.sqrt(residual @ residual / (len(x) - 2)))
    if slope <= 0.0 or scatter > SCATTER * slope:
        return None
    return slope, scatter / math.sqrt(width), float(np.exp(y.mean() - slope * x.mean()))


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """The part of the transient that is studied."""

    transient: Transient  # with `BASE_POINTS` points on a period of the fastest ringing
    whole: float  # stop time of `verify`, s
    period: float  # of the fastest ringing, or 2 pi / |p| of the fastest mode, s

    @property
    def text(self) -> str:
        """The studied part in words."""
        stop, periods = self.transient.stop, self.transient.stop / self.period
        if stop >= self.whole:
            return f"the whole transient, {show(stop, 's')}, {periods:.3g} periods"
        return (
            f"the first {show(stop, 's')} of {show(self.whole, 's')} ({periods:.3g} of"
            f" {self.whole / self.period:.4g} periods)"
        )


def study_extent(scene: Scene, circuit: Circuit) -> Extent:
    """Choose the part of the transient: at most `PERIODS` periods of the fastest ringing.

    Raises
    ------
    InputError, NoVerdictError
        The board has no time scales.
    """
    scales = time_scales(circuit, initial=scene.analysis.initial)
    period = BASE_POINTS * scales.max_step_for(BASE_POINTS)
    whole = _whole(scene, scales, period)
    if not math.isfinite(whole):
        raise EngineError("the step excites no mode of this board at its outputs: nothing to study")
    stop = whole if whole < 1.1 * PERIODS * period else float(f"{PERIODS * period:.3g}")
    return Extent(even_transient(scene, scales, BASE_POINTS, stop), whole, period)


def _whole(scene: Scene, scales: TimeScales, period: float) -> float:
    """Return the stop time of `verify`, s, without its upper limit."""
    if scene.analysis.stop != "auto":
        return scene.analysis.stop
    settled = AFTER_SETTLING * scales.stop_for(REMAINDER * scene.checks.steady_state.tolerance)
    growth = scales.growth_time
    return max(growth if math.isfinite(growth) else settled, FEWEST_PERIODS * period)


@dataclass(frozen=True, slots=True)
class SettingResult:
    """The results of one setting of one method."""

    DOCUMENT = (
        *("setting = known_setting", "status", "seconds [s]", "seconds_fastest [s] = fastest"),
        *("seconds_slowest [s] = slowest", "repeats", "steps", "factorisations"),
        *("mean_step [s]", "error", "reference", "note"),
    )

    method: Method
    setting: float
    status: str = "done"  # or "timeout" or "failed"
    seconds: float | None = None  # median of the wall times, s; the limit after a time-out
    fastest: float | None = None  # s
    slowest: float | None = None  # s
    repeats: int = 0
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
        *("name = method.name", "engine = method.engine", "problem = method.problem"),
        *("setting = method.setting", "order = order.value", "order_uncertainty = order.sigma"),
        *("order_theory = method.order", "order_theory_says = method.theory"),
        *("order_points = fitted # settings that the fit used", "points"),
    )

    method: Method
    order: Order
    points: tuple[SettingResult, ...]

    @property
    def fitted(self) -> tuple[float, ...]:
        """The settings that the fit of the order used."""
        return tuple(self.points[place].setting for place in self.order.points)


@dataclass(frozen=True, slots=True, eq=False)
class CheapestSetting:
    """The setting with the least run time below an error."""

    DOCUMENT = (
        *("method = point.method.name", "setting = point.known_setting"),
        *("seconds [s] = point.seconds", "achieved = point.error"),
    )

    point: SettingResult


@dataclass(frozen=True, slots=True, eq=False)
class Cheapest:
    """The cheapest setting below an error: of any engine, and of ngspice."""

    error: float
    any: CheapestSetting | None
    ngspice: CheapestSetting | None


@dataclass(frozen=True, slots=True, eq=False)
class WorkPrecisionStudy(Result):
    """A work-precision study of one scene."""

    VIEW = "taction.verification.report.views.accuracy:view"
    DOCUMENT = (
        *("scene = scene.name", "file = scene.file", "stop [s] = extent.transient.stop"),
        *("whole_stop [s] = extent.whole", "stretch = extent.text", "period [s] = extent.period"),
        *("problems", "methods = ladders", "cheapest = cheapest_settings", "omissions"),
        *("machine", "seconds [s]"),
    )

    scene: Scene
    points: tuple[SettingResult, ...]  # by method and setting, coarse to fine
    problems: dict[str, References]  # of "board" and "ideal"
    extent: Extent  # the part of the transient that was studied
    omissions: tuple[str, ...]  # methods and settings that were not run, and why
    machine: dict[str, str | int | float | None]  # see `describe_machine`
    seconds: float  # wall time of the study

    @property
    def outcome(self) -> str:
        """``pass`` if a run of the board has a known error, else ``inconclusive``."""
        return "pass" if self.conclusive else "inconclusive"

    @property
    def ladders(self) -> tuple[Ladder, ...]:
        """The methods with their results and their orders."""
        methods = dict.fromkeys(point.method for point in self.points)
        return tuple(Ladder(each, self.order(each), self.of(each)) for each in methods)

    @property
    def cheapest_settings(self) -> tuple[Cheapest, ...]:
        """The cheapest settings below each of `ERRORS`."""

        def found(error: float, engines: Iterable[str] | None) -> CheapestSetting | None:
            point = self.cheapest(error, engines)
            return None if point is None else CheapestSetting(point)

        return tuple(Cheapest(e, found(e, None), found(e, ["ngspice"])) for e in ERRORS)

    @property
    def conclusive(self) -> bool:
        """Whether the board was run, and the error of a run is known."""
        return self.cheapest(math.inf) is not None

    def of(self, method: Method) -> tuple[SettingResult, ...]:
        """Return the points of one method."""
        return tuple(point for point in self.points if point.method is method)

    def order(self, method: Method) -> Order:
        """Return the order of convergence of the errors of one method."""
        if not method.setting:
            return Order()
        points, floor = self.of(method), self.problems[method.problem].floor or 0.0
        return fit_order([p.mean_step for p in points], [p.error for p in points], floor)

    def cheapest(self, error: float, engines: Iterable[str] | None = None) -> SettingResult | None:
        """Return the fastest setting for the board whose error is at most `error`, or None."""
        accurate = [
            (point.seconds, point)
            for point in self.points
            if point.method.problem == "board"
            and (engines is None or point.method.engine in set(engines))
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
        Wall time for the runs, s; the finest settings are left out when it is used up.
    progress : callable, optional
        Receives the name of each stage, with what is left of the budget.

    Returns
    -------
    WorkPrecisionStudy
        Every run with its error and its time; `conclusive` if a run has a known error.

    Raises
    ------
    InputError
        The scene cannot be used.

    Examples
    --------
    >>> import taction
    >>> study = taction.accuracy("scenes/tuned-breadboard.toml", budget=0.5)
    >>> study.scene.name, len(study.points) > 0
    ('tuned-breadboard', True)
    """
    started, scene = clock.perf_counter(), read_scene(scene)
    end = started + budget

    def say(stage: str) -> None:
        progress(f"{stage}, about {duration(max(end - clock.perf_counter(), 0.0))} left")

    say("synthesis")
    problem = make_problem(scene)
    circuit, network = synthesise(scene, problem), ideal_network(problem, scene)
    extent = study_extent(scene, circuit)
    task = MethodTask(circuit, extent.transient, network, initial_voltages(scene, network))
    usable, omissions = _applicable(METHODS, circuit)
    with Worker() as worker:
        worker.call(START_UP, load_integrators)
        found, not_run = _run_all(task, usable, end, worker, say)
        say("references")

        def call(solve: Solve, task: MethodTask, time: Floats) -> Floats:
            left = end - clock.perf_counter()
            return worker.call(max(left, REFERENCE_TIME), solve, task, time)

        problems = {
            name: References.of(task, name, runs, call)
            for name in ("board", "ideal")
            if (runs := [r for p, r in found if r is not None and p.method.problem == name])
        }
    omissions += [*not_run, *(o for each in problems.values() for o in each.omissions)]
    study = WorkPrecisionStudy(
        scene=scene,
        points=tuple(_compared(point, run, problems) for point, run in found),
        problems={name: each for name, each in problems.items() if each.references},
        extent=extent,
        omissions=tuple(omissions),
        machine=describe_machine(),
        seconds=clock.perf_counter() - started,
    )
    if not study.conclusive:
        progress(Notice("no run of the board has a known error; give a larger --budget"))
    return study


def _compared(
    point: SettingResult, run: MethodRun | None, problems: dict[str, References]
) -> SettingResult:
    """Return a point with its error."""
    if run is None:
        return point
    error, reference = problems[point.method.problem].error(run, point.method.name)
    return replace(point, error=error, reference=reference)


def _applicable(methods: Sequence[Method], circuit: Circuit) -> tuple[list[Method], list[str]]:
    """Return the methods that this board and this machine can run, and the omissions."""
    try:
        find_simulator()
        missing = ""
    except SimulationError as error:
        missing = str(error).splitlines()[0]
    usable, omissions = [], list(NEVER_RUN)
    for method in methods:
        reason = missing if method.engine == "ngspice" else method.refuses(circuit)
        if reason:
            omissions.append(f"{method.name}: not run, {reason}")
        else:
            usable.append(method)
    return usable, omissions


def _run_all(
    task: MethodTask, methods: Sequence[Method], end: float, worker: Worker, progress: Progress
) -> tuple[list[tuple[SettingResult, MethodRun | None]], list[str]]:
    """Run every setting, the coarsest of all methods first, until the time `end`.

    Return the points with their runs, in the order of the ladders, and what was not run.
    """
    found: dict[tuple[str, float], tuple[SettingResult, MethodRun | None]] = {}
    stopped: dict[str, str] = {}
    for level in zip_longest(*([(m, s) for s in m.ladder] for m in methods)):
        for method, setting in filter(None, level):
            left = end - clock.perf_counter()
            if left <= 0.0 and found:
                stopped.setdefault(method.name, "the budget was used up")
            if method.name in stopped:
                continue
            point = SettingResult(method, setting)
            progress(f"{method.name}, {point.name}")
            point, run = _run(task, point, SHARE * max(left, LEAST_TIME), worker)
            found[method.name, setting] = point, run
            if point.status == "timeout":
                stopped[method.name] = "the setting before timed out"
    not_run = []
    for m in methods:
        missing = [f"{s:g}" for s in m.ladder if (m.name, s) not in found]
        if missing:
            settings = f", {m.setting} {', '.join(missing)}" if m.setting else ""
            not_run.append(f"{m.name}{settings}: not run, {stopped[m.name]}")
    return [found[m.name, s] for m in methods for s in m.ladder if (m.name, s) in found], not_run


def _run(
    task: MethodTask, point: SettingResult, limit: float, worker: Worker
) -> tuple[SettingResult, MethodRun | None]:
    """Run a setting up to `REPEATS` times within `limit` s; return its point and a run."""
    method, seconds = point.method, list[float]()
    stop = task.transient.stop if method.problem == "board" else task.ideal_stop
    end, run = clock.perf_counter() + limit, None
    while len(seconds) < REPEATS and (not seconds or clock.perf_counter() + seconds[0] < end):
        try:
            if method.engine == "ngspice":  # starts its own process
                run = method.run(task, point.setting, limit)
            else:
                run = worker.call(limit, method.run, task, point.setting)
        except TimeoutError as error:
            late = replace(point, status="timeout", seconds=limit, note=str(error))
            return (point, run) if seconds else (late, None)
        except FAILURES as error:
            note = f"{type(error).__name__}: {error}".splitlines()[0]
            return replace(point, status="failed", note=note), None
        seconds.append(run.seconds)
        point = replace(
            point,
            seconds=statistics.median(seconds),
            fastest=min(seconds),
            slowest=max(seconds),
            repeats=len(seconds),
            steps=run.steps,
            factorisations=run.factorisations,
            mean_step=stop / run.steps if run.steps else None,
        )
    return point, run
