"""Error against run time of one scene for every engine, method and tolerance or step.

`run_study` runs the ladders of `METHODS` and measures each run against references by other solvers;
`WorkPrecisionStudy.cheapest` returns the fastest setting that reaches a given error. The part of
the transient is chosen that the study can run in its budget, and the order of convergence is fitted
to the asymptotic part of each ladder.
"""

from __future__ import annotations

import math
import statistics
import time as clock
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import EngineError, SimulationError
from taction.system.progress import Progress
from taction.system.quantities import show
from taction.system.results import Result
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.reference.dynamics import IdealNetwork
from taction.verification.reference.ideal_answer import ideal_network, initial_voltages
from taction.verification.studies.running.versions import describe_machine
from taction.verification.studies.running.worker import START_UP, Worker
from taction.verification.studies.work_precision.errors import (
    NORMS,
    Errors,
    ProblemErrors,
    measure_runs,
)
from taction.verification.studies.work_precision.ladders import SettingRuns, run_ladders
from taction.verification.studies.work_precision.methods import (
    BASE_POINTS,
    METHODS,
    Method,
    MethodTask,
    load_integrators,
    ngspice,
)
from taction.verification.verdict.transient_plan import (
    AFTER_SETTLING,
    FEWEST_PERIODS,
    REMAINDER,
    even_transient,
)

MAX_ERROR = 0.1  # a larger error is not asymptotic
ABOVE_FLOOR = 10.0  # least error of a run, in errors of the reference
SCATTER = 0.12  # rms deviation of ln(error) from a straight line, over its slope
MIN_RUNS = 3


@dataclass(frozen=True, slots=True)
class Order:
    """A fitted order of convergence, ``error = constant * step^value``; None without an order."""

    value: float | None
    sigma: float | None  # standard uncertainty of `value`
    constant: float | None  # error at a step of 1 s
    points: tuple[int, ...]  # places in the ladder that the fit used
    reason: str  # why points were left out, or why there is no order


def fit_order(
    steps: Sequence[float | None],
    errors: Sequence[float | None],
    floor: float,
    names: Sequence[str],
) -> Order:
    """Fit a straight line to ``ln error`` over ``ln step`` where the ladder is asymptotic.

    Points with an error above `MAX_ERROR` or below `ABOVE_FLOOR` times `floor` are left out. Of the
    others the fit uses the longest sequence of neighbours near a straight line (`SCATTER`), the
    finer one of two sequences of the same length.

    Parameters
    ----------
    steps : sequence of float or None
        Mean step of each run, s; coarse to fine. None where there is no run.
    errors : sequence of float or None
        Error of each run; None where it is unknown.
    floor : float
        Error of the reference.
    names : sequence of str
        Names of the runs in `Order.reason`.
    """
    usable, omissions = [], []
    for place, (step, error) in enumerate(zip(steps, errors, strict=True)):
        if step is None or error is None or not (step > 0.0 and math.isfinite(error)):
            omissions.append(f"{names[place]} has no error")
        elif error > MAX_ERROR:
            omissions.append(f"{names[place]} is not asymptotic")
        elif error < ABOVE_FLOOR * floor:
            omissions.append(f"{names[place]} is at the reference's own error")
        else:
            usable.append(place)
    x = np.log([float(steps[k] or 1.0) for k in usable])
    y = np.log([float(errors[k] or 1.0) for k in usable])
    for count in range(len(usable), MIN_RUNS - 1, -1):
        for first in range(len(usable) - count, -1, -1):
            part = slice(first, first + count)
            line = _line(x[part], y[part])
            if line is not None:
                used = usable[part]
                omissions += [f"{names[k]} is off the line" for k in usable if k not in used]
                return Order(*line, tuple(used), "; ".join(omissions))
    reason = f"fewer than {MIN_RUNS} runs on a straight line"
    return Order(None, None, None, (), "; ".join([reason, *omissions]))


def _line(x: Floats, y: Floats) -> tuple[float, float, float] | None:
    """Return slope, uncertainty and constant; None if the points are not on a line."""
    spread = x - x.mean()
    width = float(spread @ spread)
    if width <= 0.0:
        return None
    slope = float(spread @ y) / width
    residual = y - y.mean() - slope * spread
    scatter = float(np.sqrt(residual @ residual / max(len(x) - 2, 1)))
    if slope <= 0.0 or scatter > SCATTER * slope:
        return None
    return slope, scatter / math.sqrt(width), float(np.exp(y.mean() - slope * x.mean()))


RUNS = 2.0  # of each setting that fit in the budget
NGSPICE_SHARE = 0.6  # of the time for the ladders
MAX_PERIODS = 100.0  # of ringing; more periods show nothing new of a method
UNTIMED_PERIODS = 30.0  # without ngspice, whose time per point sets the number


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """The part of the transient that is studied."""

    transient: Transient  # with `BASE_POINTS` points on a period of the fastest ringing
    whole: float  # stop time of `verify`, s
    period: float  # of the fastest ringing, or 2 pi / |p| of the fastest mode, s
    pole: complex | None  # rightmost oscillating mode that the step excites, 1/s

    @property
    def text(self) -> str:
        """The studied part in words."""
        stop, periods = self.transient.stop, self.transient.stop / self.period
        if stop >= self.whole:
            return f"the whole transient, {show(stop, 's')}, {periods:.3g} periods"
        return (
            f"the first {show(stop, 's')} of {show(self.whole, 's')} ({periods:.3g} of"
            f" {self.whole / self.period:.4g} periods), all that the budget affords"
        )


def study_extent(
    scene: Scene,
    circuit: Circuit,
    network: IdealNetwork,
    methods: Iterable[Method],
    seconds: float,
) -> Extent:
    """Choose the part that all ladders of `methods` can run in about `seconds`.

    A short ngspice run measures the time per point.

    Raises
    ------
    InputError, NoVerdictError
        The board has no time scales, or ngspice fails.
    """
    scales = time_scales(circuit, initial=scene.analysis.initial)
    period = BASE_POINTS * scales.max_step_for(BASE_POINTS)
    whole = _whole(scene, scales, period)
    if not math.isfinite(whole):
        raise EngineError("the step excites no mode of this board at its outputs: nothing to study")
    points = sum(sum(method.ladder) for method in methods if method.engine == "ngspice")
    periods = UNTIMED_PERIODS
    if points:
        probe = _transient(scene, scales, min(whole, FEWEST_PERIODS * period))
        task = MethodTask(circuit, probe, network, np.zeros(0))
        try:
            run = ngspice(task, BASE_POINTS, seconds, "trapezoidal")
        except TimeoutError:
            raise EngineError(
                f"the budget is too short for this board: ngspice needs more than {seconds:.3g} s"
                f" for {FEWEST_PERIODS:g} periods of the ringing; a larger --budget gives it more"
            ) from None
        periods = NGSPICE_SHARE * seconds / (RUNS * points * run.seconds / max(run.steps, 1))
    periods = min(max(periods, FEWEST_PERIODS), MAX_PERIODS)
    stop = whole if whole < 1.1 * periods * period else float(f"{periods * period:.3g}")
    return Extent(_transient(scene, scales, stop), whole, period, _pole(scales))


def _transient(scene: Scene, scales: TimeScales, stop: float) -> Transient:
    return even_transient(scene, scales, BASE_POINTS, stop)


def _whole(scene: Scene, scales: TimeScales, period: float) -> float:
    """Return the stop time of `verify`, s, without its upper limit."""
    if scene.analysis.stop != "auto":
        return scene.analysis.stop
    rest = REMAINDER * scene.checks.steady_state.tolerance
    settled = AFTER_SETTLING * scales.stop_for(rest)
    growth = scales.growth_time
    return max(growth if math.isfinite(growth) else settled, FEWEST_PERIODS * period)


def _pole(scales: TimeScales) -> complex | None:
    """Return the rightmost of the oscillating modes that the step excites."""
    poles = [complex(-1.0 / r.decay, 2.0 * math.pi * r.frequency) for r in scales.ringing]
    return max(poles, key=lambda pole: pole.real, default=None)


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
    errors: Errors  # by norm, see `taction.verification.studies.work_precision.errors`
    reference: str
    note: str  # message of the error

    @property
    def known_setting(self) -> float | None:
        """The setting; None of a method without one."""
        return self.setting if self.method.setting else None


@dataclass(frozen=True, slots=True, eq=False)
class Ladder:
    """A method with the results of its settings, and its order of convergence."""

    DOCUMENT = (
        *("name = method.name", "engine = method.engine", "problem = method.problem"),
        *("setting = method.setting", "order = order.value", "order_uncertainty = order.sigma"),
        *("order_theory = method.order", "order_theory_says = method.theory"),
        *("order_points = fitted # settings that the fit used", "order_reason = order.reason"),
        "points",
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
        *("seconds [s] = point.seconds", "achieved = point.errors.maximum"),
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
        *("pole [1/s] = extent.pole", "norms", "problems", "methods = ladders"),
        *("cheapest = cheapest_settings", "omissions", "machine", "seconds [s]"),
    )

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
    def norms(self) -> tuple[str, ...]:
        """The names of the errors."""
        return tuple(NORMS)

    @property
    def ladders(self) -> tuple[Ladder, ...]:
        """The methods with their results."""
        methods = dict.fromkeys(point.method for point in self.points)
        return tuple(Ladder(each, self.orders[each.name], self.of(each)) for each in methods)

    @property
    def cheapest_settings(self) -> tuple[Cheapest, ...]:
        """The cheapest settings below each of `ERRORS`."""

        def found(error: float, engines: Iterable[str] | None) -> CheapestSetting | None:
            point = self.cheapest(error, engines=engines)
            return None if point is None else CheapestSetting(point)

        return tuple(Cheapest(e, found(e, None), found(e, ["ngspice"])) for e in ERRORS)

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
    task = MethodTask(circuit, extent.transient, network, initial_voltages(scene, network))
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


def _point(task: MethodTask, entry: SettingRuns, problem: ProblemErrors) -> SettingResult:
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
