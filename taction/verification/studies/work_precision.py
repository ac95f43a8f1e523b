"""Error against run time of one scene for every engine, method and tolerance or step.

`accuracy` runs the settings of `METHODS`, coarse to fine, and compares each with the exact
solution, or one with a far smaller tolerance.
"""

from __future__ import annotations

import math
import statistics
import time as clock
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import PHYSICAL_BOUND, Cost, Floats, Waveforms
from taction.system.errors import EngineError
from taction.system.progress import Notice, Progress
from taction.system.quantities import show
from taction.system.results import Result
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.process import find_simulator, missing_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.study import FAILURES, Worker
from taction.verification.studies.running.versions import describe_machine
from taction.verification.verdict.run import outputs
from taction.verification.verdict.transient_plan import truncation_for

BASE_POINTS = 125.0  # points per period of the task's transient
COMPARED = 1000  # instants of a record that are compared with the reference, about
LONGEST = 86400.0  # s: the study ends the process of a run that takes too long


def thinned(run: Waveforms) -> Waveforms:
    """Return a run with about `COMPARED` of its instants, equally spaced."""
    count = len(run.time)
    kept = np.unique(np.append(np.arange(0, count, -(-count // COMPARED)), count - 1))
    return replace(run, time=run.time[kept], values=run.values[kept])


def ngspice(
    circuit: Circuit, transient: Transient, points: float, method: Literal["trapezoidal", "gear"]
) -> Waveforms:
    """Run ngspice with `points` points on a ringing period."""
    simulator = find_simulator()
    step = transient.max_step * BASE_POINTS / points
    even = replace(transient, max_step=step, truncation=truncation_for(points), method=method)
    deck = write_deck(circuit, even, solver=simulator.solver_option)
    bound = PHYSICAL_BOUND * circuit.value("U0")
    return _run(circuit, process.simulate(deck, simulator, timeout=LONGEST, bound=bound))


def exact(
    circuit: Circuit, transient: Transient, setting: None = None, *, times: Floats | None = None
) -> Waveforms:
    """Run the exact engine; without `times` with `BASE_POINTS` points on a ringing period."""
    started, found = clock.perf_counter(), stepped.simulate(circuit, transient, times=times)
    cost = Cost(clock.perf_counter() - started, 0, 1)  # with the linearisation
    return _run(circuit, replace(found, cost=cost))


def implicit(
    circuit: Circuit, transient: Transient, tolerance: float, *, times: Floats | None = None
) -> Waveforms:
    """Run the adaptive implicit engine, also on a linear board."""
    return _run(circuit, stepped.integrate(circuit, transient, times=times, tolerance=tolerance))


def _run(circuit: Circuit, found: Waveforms) -> Waveforms:
    """Return of a run what is compared and can be pickled: outputs, with its cost."""
    nodes = tuple(out.node for out in circuit.outputs)
    return Waveforms(found.time, nodes, outputs(circuit, found), "", found.cost)


TOLERANCES = tuple(10.0**-k for k in range(2, 11))
POINTS = (16.0, 32.0, 64.0, 125.0, 250.0, 500.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Method:
    """One integration method of one engine."""

    name: str
    engine: Literal["ngspice", "statespace"]
    setting: str  # name of the ladder's quantity; empty for a method without a step
    ladder: tuple[float | None, ...]  # coarse to fine
    run: Callable[..., Waveforms]  # of circuit, transient (with `BASE_POINTS`) and setting


STEP, EXACT = "points per period", "state space, exact"

METHODS: tuple[Method, ...] = (
    Method("ngspice trapezoidal", "ngspice", STEP, POINTS, partial(ngspice, method="trapezoidal")),
    Method("ngspice Gear", "ngspice", STEP, POINTS, partial(ngspice, method="gear")),
    Method(EXACT, "statespace", "", (None,), exact),
    Method("state space, implicit", "statespace", "tolerance", TOLERANCES, implicit),
)

PERIODS = 30.0  # of ringing that are studied
REPEATS = 3
LEAST_TIME = 20.0  # s for a run and for a reference at least, whatever is left of the budget
ERRORS = tuple(10.0**-k for k in range(2, 11))


@dataclass(frozen=True, slots=True)
class SettingResult:
    """The results of one setting of one method."""

    DOCUMENT = (
        *("method = method.name", "engine = method.engine", "quantity = method.setting"),
        *("setting", "status", "seconds [s]", "steps", "error", "reference"),
        "note",
    )

    method: Method
    setting: float | None  # None of a method without one
    status: str = "done"  # or "timeout" or "failed"
    seconds: float | None = None  # median of the wall times, s; of a time-out its limit
    steps: int | None = None  # of one run
    error: float | None = None  # largest over time and channels, over the step amplitude
    reference: str = ""
    note: str = ""  # message of the error

    @property
    def name(self) -> str:
        """The setting in words."""
        return "-" if self.setting is None else f"{self.setting:g} {self.method.setting}"


@dataclass(frozen=True, slots=True, eq=False)
class WorkPrecisionStudy(Result):
    """A work-precision study of one scene."""

    VIEW = "taction.verification.report.views.evidence_view:accuracy_view"
    DOCUMENT = (
        *("scene = scene.name", "file = scene.file", "stop [s] = transient.stop"),
        *("stretch", "period [s]", "references", "reference_error = floor"),
        *("step_amplitude [V] = amplitude", "runs = points", "omissions"),
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

    def of(self, method: Method) -> tuple[SettingResult, ...]:
        """Return the points of one method."""
        return tuple(point for point in self.points if point.method is method)

    def cheapest(self, error: float, engines: Iterable[str] | None = None) -> SettingResult | None:
        """Return the fastest setting whose error is at most `error`, or None."""
        accurate = (
            point
            for point in self.points
            if (engines is None or point.method.engine in engines)
            and point.error is not None
            and point.error <= error
        )
        return min(accurate, key=lambda point: point.seconds or math.inf, default=None)


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
    circuit, initial, end = synthesise(scene), scene.analysis.initial, started + budget
    step = time_scales(circuit, initial=initial).max_step_for(BASE_POINTS)
    period = BASE_POINTS * step
    stop = PERIODS * period
    if scene.analysis.stop != "auto":
        stop = min(stop, scene.analysis.stop)
    transient = Transient(stop, step, truncation_for(BASE_POINTS), initial=initial)
    board, left_out, task = LinearBoard(circuit), list[str](), (circuit, transient)
    runs, usable = list[Run](), [*_applicable(board, left_out)]
    with Worker() as worker:
        for k, method in enumerate(usable):
            left = max(end - clock.perf_counter(), 0.0)
            progress(f"{method.name}, {left:.0f} s left")
            runs += _ladder(worker, task, method, left / (len(usable) - k), left_out)
        progress("references")
        limit = max(end - clock.perf_counter(), LEAST_TIME)
        time = np.unique(np.concatenate([[0.0], *(run.time for _, run in runs if run)]))
        solved = _references(worker, task, board, time, limit, left_out)
    points, floor, amplitude = _compared(runs, solved, time)
    found = points, tuple(solved), floor, amplitude, transient, period, tuple(left_out)
    seconds = clock.perf_counter() - started
    made = WorkPrecisionStudy(scene, *found, describe_machine(), seconds)
    if made.outcome != "pass":
        progress(Notice("no run has a known error; give a larger --budget"))
    return made


Task = tuple[Circuit, Transient]
Run = tuple[SettingResult, Waveforms | None]


def _references(
    worker: Worker, task: Task, board: LinearBoard, time: Floats, limit: float, left_out: list[str]
) -> dict[str, Floats]:
    """Return two solutions at `time` (P,), s, by name, the better first, if there is time.

    Each takes `limit`, s, at most.
    """
    # Of a large board a smaller tolerance gains nothing over rounding errors.
    tight = 1e-9 if board.descriptor.is_large else 1e-12
    known: dict[str, Callable[..., Waveforms]] = {EXACT: exact} if is_exact(board) else {}
    for each in (tight, 100.0 * tight)[: 2 - len(known)]:
        known[f"state space, implicit at {each:g}"] = partial(implicit, tolerance=each)
    solved = dict[str, Floats]()
    for name, solve in known.items() if len(time) > 1 else ():
        try:
            solved[name] = worker.call(limit, solve, *task, times=time).values
        except (TimeoutError, *FAILURES) as error:
            left_out.append(f"reference, {name}: {error}")
    return solved


def _compared(
    runs: Sequence[Run], solved: Mapping[str, Floats], time: Floats
) -> tuple[tuple[SettingResult, ...], float | None, float]:
    """Return the settings with their errors beside the first solution of another method.

    Also the largest difference of two solutions over the step amplitude, and this amplitude, V.
    """
    if not solved:
        return tuple(point for point, _ in runs), None, math.nan
    first, *others = solved.values()
    amplitude = float(np.abs(first - first[0]).max())
    if not amplitude:
        raise EngineError("the step moves no output of this board: nothing to study")
    floor = float(np.abs(others[0] - first).max() / amplitude) if others else None
    points = []
    for point, run in runs:
        name = next((name for name in solved if name != point.method.name), None)
        if run is not None and name is not None:
            off = np.abs(run.values - solved[name][np.searchsorted(time, run.time)]).max()
            point = replace(point, error=float(off / amplitude), reference=name)
        points.append(point)
    return tuple(points), floor, amplitude


def _applicable(board: LinearBoard, left_out: list[str]) -> Iterator[Method]:
    """Yield the methods that this board and this machine can run; `left_out` gets the others."""
    missing, large = missing_simulator(), "too many unknowns for dense matrices"
    inexact = large if board.circuit.is_linear else "it is not linear"
    inexact = "" if is_exact(board) else inexact
    for method in METHODS:
        reason = missing if method.engine == "ngspice" else inexact * (method.name == EXACT)
        if reason:
            left_out.append(f"{method.name}: not run, {reason}")
        else:
            yield method


def _ladder(
    worker: Worker, task: Task, method: Method, seconds: float, left_out: list[str]
) -> Iterator[Run]:
    """Yield the settings of a method and their last runs, coarse to fine, for some `seconds`."""
    end = clock.perf_counter() + seconds
    for place, setting in enumerate(method.ladder):
        point, times, run = SettingResult(method, setting), list[float](), None
        if place and clock.perf_counter() > end:
            left_out.append(f"{method.name}: not run from {point.name} on, no time is left")
            return
        limit = max(end - clock.perf_counter(), LEAST_TIME)
        try:
            while len(times) < REPEATS and (not times or clock.perf_counter() + times[0] < end):
                run = worker.call(limit, method.run, *task, setting)
                times.append(run.cost.seconds)
        except TimeoutError as error:
            if run is None:
                yield replace(point, status="timeout", seconds=limit, note=str(error)), None
                return
        except FAILURES as error:
            note = f"{type(error).__name__}: {error}".splitlines()[0]
            yield replace(point, status="failed", note=note), None
            continue
        assert run is not None  # noqa: S101 - the first call gave it, or ended this setting
        point = replace(point, seconds=statistics.median(times), steps=run.cost.points)
        yield point, thinned(run)
