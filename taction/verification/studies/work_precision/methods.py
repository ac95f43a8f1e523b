"""The table `METHODS` of the integration methods that a work-precision study compares.

A new method needs an entry in the table and a function that runs it. The order is that of the
largest error over time as a function of the mean step.
"""

from __future__ import annotations

import re
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import write_deck
from taction.system.array_types import Floats
from taction.system.errors import EngineError, TimedOut
from taction.system.foreign_files import read_ends
from taction.system.own_folders import own_folder
from taction.system.waveforms import PHYSICAL_BOUND, Cost, Waveforms
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import LONGEST_LOG
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.engines.statespace.transients.record_times import record_times
from taction.verification.engines.statespace.transients.simulate import ENGINE
from taction.verification.reference.dynamics import IdealNetwork, ScaledNetwork
from taction.verification.verdict.companion import outputs
from taction.verification.verdict.transient_plan import coarser

BASE_POINTS = 125.0  # points per period of the task's transient
COMPARED = 1000  # instants of a record that are compared with the reference, at most
IDEAL_STOP = 10.0  # times R C: the slowest mode has decayed to 5e-5
Integrator = Literal["Radau", "BDF", "LSODA", "DOP853"]
_COUNT = {
    "steps": re.compile(r"^Accepted timepoints = (\d+)", re.MULTILINE),
    "factorisations": re.compile(r"^Total iterations = (\d+)", re.MULTILINE),
}


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


@dataclass(frozen=True, slots=True, eq=False)
class MethodRun:
    """One run of one method."""

    time: Floats  # compared instants (P,), s
    u: Floats  # (P, N), V
    seconds: float  # wall time of the ngspice process, or of the computation with its output
    steps: int  # accepted steps; 0 for a method without steps
    factorisations: int | None  # (ngspice: one per Newton iteration); None: unknown


def load_integrators() -> None:
    """Import SciPy's integrators before the first measurement."""
    import scipy.integrate  # noqa: F401


def ngspice(
    task: MethodTask, points: float, timeout: float, method: Literal["trapezoidal", "gear"]
) -> MethodRun:
    """Run ngspice with `points` points on a ringing period; TimeoutError after `timeout` s."""
    simulator = find_simulator()
    transient = replace(coarser(task.transient, BASE_POINTS / points), method=method)
    deck = write_deck(task.circuit, transient, solver=simulator.solver_option)
    # The option acct makes ngspice print its steps and iterations.
    deck = replace(deck, text=deck.text.replace("\n.options ", "\n.options acct ", 1))
    limits = {
        "timeout": min(timeout, 1e9),
        "bound": PHYSICAL_BOUND * task.circuit.value("U0"),
    }
    with own_folder() as temporary:
        folder = temporary / "run"
        try:
            waveforms = process.simulate(deck, simulator, folder=folder, keep=True, **limits)
        except TimedOut as error:
            raise TimeoutError(str(error).splitlines()[0]) from None
        log = read_ends(folder / "stdout.txt", LONGEST_LOG)
    counts = {name: pattern.search(log) for name, pattern in _COUNT.items()}
    steps, factorisations = counts["steps"], counts["factorisations"]
    return replace(
        _thinned(task, waveforms),
        steps=int(steps[1]) if steps else waveforms.cost.points,
        factorisations=int(factorisations[1]) if factorisations else None,
    )


def exact(task: MethodTask, _: float) -> MethodRun:
    """Run the exact engine with `BASE_POINTS` recorded points on a ringing period."""
    started = clock.perf_counter()
    transient = task.transient
    solution = exact_solution(task.circuit, initial=transient.initial)
    time = record_times(transient, transient.stop)
    values = solution.uniform(float(time[1]), len(time))
    cost = Cost(clock.perf_counter() - started, 0, 1)
    return _thinned(task, Waveforms(time, solution.nodes, values, ENGINE, cost))


def implicit(task: MethodTask, tolerance: float) -> MethodRun:
    """Run the adaptive implicit engine, also on a linear board."""
    return _thinned(task, stepped.simulate(task.circuit, task.transient, tolerance=tolerance))


def scipy_run(task: MethodTask, tolerance: float, method: Integrator) -> MethodRun:
    """Run an integrator of SciPy on the ideal network and record the ends of its steps."""
    started = clock.perf_counter()
    time, u, factorisations = integrate_ideal(task, tolerance, method)
    seconds = clock.perf_counter() - started
    chosen = _compared(len(time))
    return MethodRun(time[chosen], u[chosen], seconds, len(time) - 1, factorisations)


def integrate_ideal(
    task: MethodTask, tolerance: float, method: Integrator, times: Floats | None = None
) -> tuple[Floats, Floats, int]:
    """Integrate the ideal network with SciPy.

    Returns
    -------
    time, u : ndarray (P,) and (P, N)
        `times`, or if they are None the ends of the integrator's steps, s; outputs there, V.
    factorisations : int
        Of matrices.

    Raises
    ------
    EngineError
        The integration failed.
    """
    from scipy.integrate import solve_ivp

    network, scaled = task.network, ScaledNetwork(task.network)
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
        message = f"{method} gave up: {solution.message}"
        raise EngineError(message)
    return solution.t * unit, u, int(solution.nlu)


def _compared(count: int) -> NDArray[np.intp]:
    """Return the indices of the compared points of a record: equally spaced, and the last one."""
    return np.unique(np.append(np.arange(0, count, -(-count // COMPARED)), count - 1))


def _thinned(task: MethodTask, waveforms: Waveforms) -> MethodRun:
    chosen, cost = _compared(len(waveforms.time)), waveforms.cost
    u = outputs(task.circuit, waveforms)[chosen]
    return MethodRun(waveforms.time[chosen], u, cost.seconds, cost.points, cost.factorisations)


TOLERANCES = tuple(10.0**-k for k in range(2, 12))
POINTS = (16.0, 32.0, 64.0, 125.0, 250.0, 500.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Method:
    """One integration method of one engine."""

    name: str
    engine: Literal["ngspice", "statespace", "scipy"]
    solver: str  # the integrator; the reference of a run must be by another solver
    problem: Literal["board", "ideal"]  # the whole circuit, or the network with ideal op-amps
    setting: str  # name of the ladder's quantity; empty for a method without a step
    ladder: tuple[float, ...]  # coarse to fine
    run: Callable[..., MethodRun]  # of task and setting; of ngspice also of a time limit in s
    order: float | None  # in theory; None for a method without an order or of variable order
    theory: str  # the order in words
    modes: bool = False  # whether it needs a linear board and dense matrices

    def refuses(self, circuit: Circuit) -> str:
        """Return why it cannot run a board, or an empty string."""
        if self.modes and not circuit.is_linear:
            return "the board is not linear"
        large = self.modes and LinearBoard(circuit).descriptor.is_large
        return "too many unknowns for dense matrices" if large else ""


VARIES = "1 to 5, chosen by the integrator"

METHODS: tuple[Method, ...] = (
    Method(
        "ngspice trapezoidal", "ngspice", "trapezoidal", "board", "points per period", POINTS,
        partial(ngspice, method="trapezoidal"), 2.0, "2",
    ),
    Method(
        "ngspice Gear", "ngspice", "Gear", "board", "points per period", POINTS,
        partial(ngspice, method="gear"), 2.0, "2 (ngspice's default maximum order)",
    ),
    Method(
        "state space, exact", "statespace", "modes", "board", "", (0.0,),
        exact, None, "no step: rounding alone", modes=True,
    ),
    Method(
        "state space, implicit", "statespace", "Radau IIA, 9 stages", "board", "tolerance",
        TOLERANCES[:-1], implicit, 10.0,
        "10 (dense output of nine Radau IIA stages; 17 at the ends of steps)",
    ),
    Method(
        "ideal network, Radau", "scipy", "Radau", "ideal", "tolerance", TOLERANCES,
        partial(scipy_run, method="Radau"), 5.0, "5",
    ),
    Method(
        "ideal network, BDF", "scipy", "BDF", "ideal", "tolerance", TOLERANCES,
        partial(scipy_run, method="BDF"), None, VARIES,
    ),
    Method(
        "ideal network, LSODA", "scipy", "LSODA", "ideal", "tolerance", TOLERANCES,
        partial(scipy_run, method="LSODA"), None, "1 to 12, chosen by the integrator",
    ),
)  # fmt: skip
