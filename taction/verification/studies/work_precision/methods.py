"""The table `METHODS` of the integration methods that a work-precision study compares.

The order is that of the largest error over time as a function of the mean step.
"""

from __future__ import annotations

import re
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from taction.netlist_gen.analysis import SimulatedDeck, Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import write_deck
from taction.system.array_types import Floats
from taction.system.foreign_files import read_ends
from taction.system.waveforms import PHYSICAL_BOUND, Waveforms
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.evidence import (
    Ending,
    accepted_waveforms,
)
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.dense import record_times
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.verdict.run import outputs
from taction.verification.verdict.transient_plan import coarser

BASE_POINTS = 125.0  # points per period of the task's transient
COMPARED = 1000  # instants of a record that are compared with the reference, about
LONGEST = 86400.0  # s: the study ends the process of a run that takes too long
STEPS = re.compile(r"^Accepted timepoints = (\d+)", re.MULTILINE)
ITERATIONS = re.compile(r"^Total iterations = (\d+)", re.MULTILINE)


@dataclass(frozen=True, slots=True, eq=False)
class MethodTask:
    """The input of every method."""

    circuit: Circuit
    transient: Transient  # with `BASE_POINTS` points on the period of the fastest ringing

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

    def accept(deck: SimulatedDeck, ending: Ending) -> tuple[Waveforms, str]:
        log = read_ends(ending.folder / process.STREAMS[0], process.LONGEST_LOG)
        return accepted_waveforms(deck, ending, engine=simulator.engine, bound=bound), log

    with process.Simulation(deck, simulator, timeout=LONGEST, bound=bound) as run:
        waveforms, log = run.accept(accept)
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


def _of_record(task: MethodTask, waveforms: Waveforms) -> MethodRun:
    cost, u = waveforms.cost, outputs(task.circuit, waveforms)
    return MethodRun(waveforms.time, u, cost.seconds, cost.points, cost.factorisations)


TOLERANCES = tuple(10.0**-k for k in range(2, 11))
POINTS = (16.0, 32.0, 64.0, 125.0, 250.0, 500.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Method:
    """One integration method of one engine."""

    name: str
    engine: Literal["ngspice", "statespace"]
    setting: str  # name of the ladder's quantity; empty for a method without a step
    ladder: tuple[float, ...]  # coarse to fine
    run: Callable[..., MethodRun]  # of task and setting
    order: float | None  # in theory; None for a method without a step
    theory: str  # the order in words


EXACT = "state space, exact"

METHODS: tuple[Method, ...] = (
    Method(
        "ngspice trapezoidal", "ngspice", "points per period", POINTS,
        partial(ngspice, method="trapezoidal"), 2.0, "2",
    ),
    Method(
        "ngspice Gear", "ngspice", "points per period", POINTS,
        partial(ngspice, method="gear"), 2.0, "2 (ngspice's default maximum order)",
    ),
    Method(EXACT, "statespace", "", (0.0,), exact, None, "no step: rounding alone"),
    Method(
        "state space, implicit", "statespace", "tolerance", TOLERANCES, implicit,
        10.0, "10 (dense output of nine Radau IIA stages; 17 at the ends of steps)",
    ),
)  # fmt: skip


def solutions(task: MethodTask) -> dict[str, Callable[..., MethodRun]]:
    """Return two solutions of the board by their names, the better first."""
    # Of a large board a smaller tolerance gains nothing over rounding errors.
    tight = 1e-9 if LinearBoard(task.circuit).descriptor.is_large else 1e-12
    found: dict[str, Callable[..., MethodRun]] = {EXACT: exact} if task.is_exact else {}
    for each in (tight, 100.0 * tight)[: 2 - len(found)]:
        found[f"state space, implicit at {each:g}"] = partial(implicit, tolerance=each)
    return found
