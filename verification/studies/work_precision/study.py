"""Error against run time of one scene: every engine, method and tolerance or step.

`study` runs the ladders of `METHODS` and measures each run against references by other solvers;
`Study.cheapest` reads the cheapest setting for a wanted error from it.
"""

from __future__ import annotations

import statistics
import time as clock
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.scalings import make_scalings
from netlist_gen.board.synthesis import synthesise
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.scene import Scene
from spice_models.errors import SimulationError
from verification.engines.ngspice.executable import find_simulator
from verification.ideal.ideal_answer import ideal_network, initial_voltages
from verification.studies.running.machine import describe_machine
from verification.studies.running.worker import START_UP, Worker
from verification.studies.work_precision.convergence_order import Order, fit_order
from verification.studies.work_precision.extent import Extent, study_extent
from verification.studies.work_precision.ladders import SettingRuns, run_ladders
from verification.studies.work_precision.method_runs import Task, load_integrators
from verification.studies.work_precision.methods import METHODS, Method
from verification.studies.work_precision.norms import NORMS, Errors
from verification.studies.work_precision.run_errors import ProblemErrors, judge_runs

BUDGET = 30.0  # s
LADDERS = 0.7  # of the budget; the rest is for the references
REFERENCE_TIME = 20.0  # s that a reference may take at least
NEVER_RUN = (
    "ngspice Gear of order 3 to 6 (maxord): not run, not stable for poles near the imaginary axis",
    "ngspice without a maximum step: not run, its steps would follow no ladder",
)
WANTED = tuple(10.0**-k for k in range(2, 11))

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class SettingResult:
    """One setting of one method.

    Attributes
    ----------
    method, setting, name : Method, float, str
        What was run; the setting in words.
    status : str
        ``"done"``; ``"timeout"``: `seconds` is what it was given, it has no errors; ``"failed"``.
    seconds, fastest, slowest : float or None
        Wall time: median and extremes of `repeats` runs, s.
    steps, factorisations : int or None
        Of one run.
    mean_step : float or None
        Length of the record over its steps, s.
    errors : dict of str to float or None
        By norm, of `verification.studies.work_precision.norms`.
    reference : str
        What the errors are measured against.
    note : str
        What went wrong.
    """

    method: Method
    setting: float
    name: str
    status: str
    seconds: float | None
    fastest: float | None
    slowest: float | None
    repeats: int
    steps: int | None
    factorisations: int | None
    mean_step: float | None
    errors: Errors
    reference: str
    note: str


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A work-precision study.

    Attributes
    ----------
    points : tuple of SettingResult
        By method and setting, coarse to fine.
    orders : dict of str to Order
        Of the largest error over time, by method.
    problems : dict of str to ProblemErrors
        Of ``"board"`` and ``"ideal"``.
    extent : Extent
        The stretch of the transient that was studied.
    omissions : tuple of str
        What was not run, and why.
    machine : dict
        Versions and machine.
    seconds : float
        What the study took.
    """

    scene: Scene
    points: tuple[SettingResult, ...]
    orders: dict[str, Order]
    problems: dict[str, ProblemErrors]
    extent: Extent
    omissions: tuple[str, ...]
    machine: dict[str, str | int | float | None]
    seconds: float

    def of(self, method: Method) -> tuple[SettingResult, ...]:
        """Points of one method."""
        return tuple(point for point in self.points if point.method is method)

    def cheapest(
        self, error: float, norm: str = "maximum", engines: Iterable[str] | None = None
    ) -> SettingResult | None:
        """Return the cheapest measured setting for the board that reaches `error`, or None."""
        reached = [
            (point.seconds, point)
            for point in self.points
            if point.method.problem == "board"
            and (engines is None or point.method.engine in set(engines))
            and point.seconds is not None
            and (found := point.errors.get(norm)) is not None
            and found <= error
        ]
        return min(reached, key=lambda pair: pair[0])[1] if reached else None


def study(
    scene: Scene,
    *,
    budget: float = BUDGET,
    methods: Sequence[Method] = METHODS,
    progress: Progress = lambda stage: None,
) -> Study:
    """Compare methods on a scene.

    Parameters
    ----------
    scene : Scene
        Its board and its ideal network; its own choice of engine and step plays no part.
    budget : float
        Wall time that it should take, s. The stretch of the transient follows from it.
    methods : sequence of Method
        What to compare.
    progress : callable, optional
        Gets the name of each stage.

    Raises
    ------
    InputError, NoVerdictError
        The scene cannot be used, or its board has no equations.
    """
    began = clock.perf_counter()
    progress("synthesis")
    problem = make_problem(scene)
    circuit = synthesise(scene, problem)
    network = ideal_network(problem, make_scalings(scene), scene)
    applicable, omissions = _applicable(methods, circuit)
    progress("time of an ngspice point")
    extent = study_extent(scene, circuit, network, applicable, LADDERS * budget)
    task = Task(circuit, extent.transient, network, initial_voltages(scene, network))
    with Worker() as worker:
        worker.call(START_UP, load_integrators)
        left = LADDERS * budget - (clock.perf_counter() - began)
        entries, not_run = run_ladders(task, applicable, left, worker, progress)
        progress("references")
        left = max(began + budget - clock.perf_counter(), REFERENCE_TIME)
        band = scene.checks.settling_time.band
        judgements = judge_runs(task, entries, band, extent.pole, worker, left)
    points = tuple(_point(task, entry, judgements[entry.method.problem]) for entry in entries)
    orders = {m.name: _order(m, points, judgements[m.problem]) for m in applicable}
    found = {name: j for name, j in judgements.items() if j.scale is not None}
    return Study(
        scene=scene,
        points=points,
        orders=orders,
        problems=found,
        extent=extent,
        omissions=(*omissions, *not_run, *(o for j in judgements.values() for o in j.omissions)),
        machine=describe_machine(),
        seconds=clock.perf_counter() - began,
    )


def _applicable(methods: Sequence[Method], circuit: Circuit) -> tuple[list[Method], list[str]]:
    """Leave out what this board or this machine has no use for, and say so."""
    try:
        find_simulator()
        missing = ""
    except SimulationError as error:
        missing = str(error).splitlines()[0]
    kept, omissions = [], list(NEVER_RUN)
    for method in methods:
        if reason := method.refuses(circuit):
            omissions.append(f"{method.name}: not run, {reason}")
        elif method.engine == "ngspice" and missing:
            omissions.append(f"{method.name}: not run, {missing}")
        else:
            kept.append(method)
    return kept, omissions


def _point(task: Task, entry: SettingRuns, judgement: ProblemErrors) -> SettingResult:
    run, seconds = entry.run, entry.seconds
    stop = task.transient.stop if entry.method.problem == "board" else task.ideal_stop
    key = (entry.method.name, entry.setting)
    errors, reference = judgement.errors.get(key, (dict.fromkeys(NORMS), ""))
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


def _order(method: Method, points: Sequence[SettingResult], judgement: ProblemErrors) -> Order:
    mine = [point for point in points if point.method is method]
    if not method.setting:
        return Order(None, None, None, (), "no step")
    return fit_order(
        [point.mean_step for point in mine],
        [point.errors["maximum"] for point in mine],
        judgement.floor["maximum"] or 0.0,
        [f"{point.setting:g}" for point in mine],
    )
