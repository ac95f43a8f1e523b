"""The table `METHODS` of the integration methods that a work-precision study compares.

A new method needs an entry in the table and a function that runs it. The order is that of the
largest error over time as a function of the mean step. `solutions` are what runs are compared with.
"""

from __future__ import annotations

import re
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from scipy.integrate import solve_ivp

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import write_deck
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.foreign_files import read_ends
from taction.system.own_folders import own_folder
from taction.system.waveforms import PHYSICAL_BOUND, Waveforms
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import LONGEST_LOG
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.dense import record_times
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.reference.dynamics import IdealNetwork, ScaledNetwork, ideal_linear
from taction.verification.verdict.measure import outputs
from taction.verification.verdict.transient_plan import coarser

BASE_POINTS = 125.0  # points per period of the task's transient
COMPARED = 1000  # instants of a record that are compared with the reference, about
LONGEST = 86400.0  # s: the study ends the process of a run that takes too long
IDEAL_STOP = 10.0  # times R C: the slowest mode has decayed to 5e-5
Integrator = Literal["Radau", "BDF", "LSODA", "DOP853"]
STEPS = re.compile(r"^Accepted timepoints = (\d+)", re.MULTILINE)
ITERATIONS = re.compile(r"^Total iterations = (\d+)", re.MULTILINE)


@dataclass(frozen=True, slots=True, eq=False)
class MethodTask:
    """The input of every method."""

    circuit: Circuit
    transient: Transient  # with `BASE_POINTS` points on the period of the fastest ringing
    network: IdealNetwork  # the same scene with ideal op-amps
    v0: Floats  # signal-node voltages of the ideal network at t = 0, (N,), V

    @property
    def ideal_stop(self) -> float:
        """Stop time of the ideal network, s."""
        return IDEAL_STOP * self.network.RC

    @property
    def is_exact(self) -> bool:
        """Whether the whole board has an exact solution: it is linear, its matrices are dense."""
        return self.circuit.is_linear and not LinearBoard(self.circuit).descriptor.is_large


@dataclass(frozen=True, slots=True, eq=False)
class MethodRun:
    """One run of one method."""

    time: Floats  # (P,), s
    u: Floats  # (P, N), V
    seconds: float  # wall time of the ngspice process, or of the computation with its output
    steps: int  # accepted steps; 0 for a method without steps
    factorisations: int | None  # (ngspice: one per Newton iteration); None: unknown

    @property
    def thinned(self) -> MethodRun:
        """The run with about `COMPARED` of its instants, equally spaced."""
        count = len(self.time)
        kept = np.unique(np.append(np.arange(0, count, -(-count // COMPARED)), count - 1))
        return replace(self, time=self.time[kept], u=self.u[kept])


def ngspice(task: MethodTask, points: float, method: Literal["trapezoidal", "gear"]) -> MethodRun:
    """Run ngspice with `points` points on a ringing period."""
    simulator = find_simulator()
    transient = replace(coarser(task.transient, BASE_POINTS / points), method=method)
    deck = write_deck(task.circuit, transient, solver=simulator.solver_option)
    # The option acct makes ngspice print its steps and iterations.
    deck = replace(deck, text=deck.text.replace("\n.options ", "\n.options acct ", 1))
    bound = PHYSICAL_BOUND * task.circuit.value("U0")
    with own_folder() as temporary:
        folder = temporary / "run"
        waveforms = process.simulate(
            deck, simulator, folder=folder, keep=True, timeout=LONGEST, bound=bound
        )
        log = read_ends(folder / "stdout.txt", LONGEST_LOG)
    steps, iterations = STEPS.search(log), ITERATIONS.search(log)
    return replace(
        _of_record(task, waveforms),
        steps=int(steps[1]) if steps else waveforms.cost.points,
        factorisations=int(iterations[1]) if iterations else None,
    )


def exact(task: MethodTask, setting: float = 0.0, *, times: Floats | None = None) -> MethodRun:
    """Run the exact engine; without `times` with `BASE_POINTS` points on a ringing period."""
    started, circuit = clock.perf_counter(), task.circuit
    solution = exact_solution(circuit, initial=task.transient.initial)
    time = record_times(task.transient, task.transient.stop) if times is None else times
    u = np.array([output.sign for output in circuit.outputs]) * solution.at(time)
    return MethodRun(time, u, clock.perf_counter() - started, 0, 1)


def implicit(task: MethodTask, tolerance: float, *, times: Floats | None = None) -> MethodRun:
    """Run the adaptive implicit engine, also on a linear board."""
    found = stepped.simulate(task.circuit, task.transient, times=times, tolerance=tolerance)
    return _of_record(task, found)


def integrate(
    task: MethodTask, tolerance: float, method: Integrator, *, times: Floats | None = None
) -> MethodRun:
    """Run an integrator of SciPy on the ideal network; without `times` at the ends of its steps.

    EngineError: the integration fails.
    """
    started, network, scaled = clock.perf_counter(), task.network, ScaledNetwork(task.network)
    unit, stop = network.RC, task.ideal_stop
    options: dict[str, Any] = {"jac": scaled.jacobian}
    if times is not None:
        stop, options = float(times[-1]), {"t_eval": times / unit}
    with np.errstate(all="ignore"):
        solution = solve_ivp(
            scaled.slope, (0.0, stop / unit), task.v0 / network.unit, method,
            rtol=tolerance, atol=tolerance, **options,
        )  # fmt: skip
        u = network.U0 * scaled.g.g(solution.y).T
    complete = solution.success and len(u) == (len(solution.t) if times is None else len(times))
    # LSODA can report success with values that are not numbers.
    if not complete or not np.all(np.isfinite(solution.y)) or not np.all(np.isfinite(u)):
        raise EngineError(f"{method} gave up: {solution.message}")
    seconds, steps = clock.perf_counter() - started, len(solution.t) - 1
    return MethodRun(solution.t * unit, u, seconds, steps, int(solution.nlu))


def modes(task: MethodTask, *, times: Floats) -> MethodRun:
    """Return the exact solution of an ideal network with linear amplifiers."""
    return MethodRun(times, ideal_linear(task.network, task.v0).outputs(times), 0.0, 0, 1)


def _of_record(task: MethodTask, waveforms: Waveforms) -> MethodRun:
    cost, u = waveforms.cost, outputs(task.circuit, waveforms)
    return MethodRun(waveforms.time, u, cost.seconds, cost.points, cost.factorisations)


TOLERANCES = tuple(10.0**-k for k in range(2, 12))
POINTS = (16.0, 32.0, 64.0, 125.0, 250.0, 500.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Method:
    """One integration method of one engine."""

    name: str
    engine: Literal["ngspice", "statespace", "scipy"]
    problem: Literal["board", "ideal"]  # the whole circuit, or the network with ideal op-amps
    setting: str  # name of the ladder's quantity; empty for a method without a step
    ladder: tuple[float, ...]  # coarse to fine
    run: Callable[..., MethodRun]  # of task and setting
    order: float | None  # in theory; None for a method without an order or of variable order
    theory: str  # the order in words


EXACT, VARIES = "state space, exact", "1 to 5, chosen by the integrator"

METHODS: tuple[Method, ...] = (
    Method(
        "ngspice trapezoidal", "ngspice", "board", "points per period", POINTS,
        partial(ngspice, method="trapezoidal"), 2.0, "2",
    ),
    Method(
        "ngspice Gear", "ngspice", "board", "points per period", POINTS,
        partial(ngspice, method="gear"), 2.0, "2 (ngspice's default maximum order)",
    ),
    Method(EXACT, "statespace", "board", "", (0.0,), exact, None, "no step: rounding alone"),
    Method(
        "state space, implicit", "statespace", "board", "tolerance", TOLERANCES[:-1], implicit,
        10.0, "10 (dense output of nine Radau IIA stages; 17 at the ends of steps)",
    ),
    Method(
        "ideal network, Radau", "scipy", "ideal", "tolerance", TOLERANCES,
        partial(integrate, method="Radau"), 5.0, "5",
    ),
    Method(
        "ideal network, BDF", "scipy", "ideal", "tolerance", TOLERANCES,
        partial(integrate, method="BDF"), None, VARIES,
    ),
    Method(
        "ideal network, LSODA", "scipy", "ideal", "tolerance", TOLERANCES,
        partial(integrate, method="LSODA"), None, "1 to 12, chosen by the integrator",
    ),
)  # fmt: skip


def solutions(task: MethodTask, problem: str) -> dict[str, Callable[..., MethodRun]]:
    """Return two solutions of a problem by their names, the better first."""
    dop853 = {"DOP853 at 1e-13": partial(integrate, tolerance=1e-13, method="DOP853")}
    if problem == "ideal" and task.circuit.is_linear:
        return {"exact modes": modes, **dop853}
    if problem == "ideal":
        return {**dop853, "LSODA at 1e-13": partial(integrate, tolerance=1e-13, method="LSODA")}
    # Of a large board a smaller tolerance gains nothing over rounding errors.
    tight = 1e-9 if LinearBoard(task.circuit).descriptor.is_large else 1e-12
    found: dict[str, Callable[..., MethodRun]] = {EXACT: exact} if task.is_exact else {}
    for each in (tight, 100.0 * tight)[: 2 - len(found)]:
        found[f"state space, implicit at {each:g}"] = partial(implicit, tolerance=each)
    return found
