"""Transients of large linear boards: Radau IIA steps by structured solves.

For ``M e' = K e`` (e is the deviation from the equilibrium) a Radau IIA step of s stages is a sum
of s independent solves with ``theta_j M / h - K``, half of them by symmetry, for any order, without
iterations on stage equations. The step control compares one step with two steps of half its size,
dense output included, and selects from a ladder of powers of two. Factorisations are kept, so a
step costs only (s + 1)/2 structured solves (see `structured_solve`).
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats, Indices, Ints
from taction.system.errors import EngineError
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns
from taction.verification.engines.statespace.transients.radau import tableau
from taction.verification.engines.statespace.transients.record_times import record_times

METHOD = "Radau IIA, structured"
STAGES = 7
TOLERANCE = 1e-5  # of one step and of its dense output, in step amplitudes
POINTS = 16  # points of the record in the first step tried
PATIENCE = 8  # steps before a longer step is tried; doubles after a failure
SMALLEST = 2.0**-40  # of the first step
ESCAPED = 1e8  # step amplitudes at which the record of a diverging board ends


class Stepper:
    """Steps of one board: the solvers of each level, with the step ``base * 2^level``, s.

    `watch` (K,) are the unknowns whose waveforms are computed.
    """

    def __init__(self, structure: Structure, watch: Ints, base: float) -> None:
        self.structure, self.watch, self.base = structure, watch, base
        self.table = tableau(STAGES)
        self.weight = self.table.shifts * self.table.left.sum(axis=1)
        self.solvers: dict[int, list] = {}  # type: ignore[type-arg]
        self.factorisations = 0

    def step_of(self, level: int) -> float:
        """Return the length of a step, s."""
        return self.base * 2.0**level

    def prepare(self, level: int) -> None:
        """Factorise for a level; delete other levels except the neighbours, to save memory."""
        if level in self.solvers:
            return
        self.solvers = {k: v for k, v in self.solvers.items() if abs(k - level) <= 1}
        h = self.step_of(level)
        shifts = self.table.shifts.tolist()
        self.solvers[level] = [self.structure.solver(shift / h) for shift in shifts]
        self.factorisations += len(shifts)

    def step(self, charge: Floats, level: int) -> tuple[Floats, Floats]:
        """Take one step from the charge ``M e`` (size,).

        Return ``M e`` at the end, and the watched deviations (s, K) at the collocation points.
        """
        self.prepare(level)
        h = self.step_of(level)
        stages = np.zeros((STAGES, len(self.watch)))
        last = np.zeros(len(charge))
        for j, solve in enumerate(self.solvers[level]):
            real = self.table.shifts[j].imag == 0.0
            y = solve(charge if real else charge.astype(np.complex128)) * (self.weight[j] / h)
            last += (self.table.right[-1, j] * y).real
            stages += np.outer(self.table.right[:, j], y[self.watch]).real
        return self.structure.mass @ last, stages

    def sample(self, start: Floats, stages: Floats, theta: Floats) -> Floats:
        """Return the watched deviations at fractions `theta` (P,) of a step, shape (P, K)."""
        nodes = np.concatenate([[0.0], self.table.c])
        return _barycentric(nodes, np.vstack([start, stages]), theta)


def _barycentric(nodes: Floats, values: Floats, at: Floats) -> Floats:
    """Evaluate the polynomial through (nodes, values) at points, shape (P, K)."""
    gaps = nodes[:, None] - nodes[None, :] + np.eye(len(nodes))
    weights = 1.0 / gaps.prod(axis=1)
    distance = at[:, None] - nodes[None, :]
    hit = distance == 0.0
    terms = weights / np.where(hit, 1.0, distance)
    result = (terms @ values) / terms.sum(axis=1)[:, None]
    rows, columns = np.nonzero(hit)
    result[rows] = values[columns]
    return np.asarray(result)


class _Run:
    """The state of one integration."""

    def __init__(self, stepper: Stepper, charge: Floats, start: Floats, tolerance: float) -> None:
        self.stepper, self.charge, self.now, self.t = stepper, charge, start, 0.0
        self.amplitude = float(np.abs(start).max(initial=0.0))
        self.tolerance, self.level, self.steps = tolerance, 0, 0
        self.patience, self.waited = PATIENCE, 0
        self.ends: list[float] = [0.0]
        self.levels: list[int] = []
        self.pieces: list[tuple[Floats, Floats]] = []

    def accept(self, charge: Floats, stages: Floats, level: int) -> None:
        self.pieces.append((self.now, stages))
        self.levels.append(level)
        self.charge, self.now = charge, stages[-1]
        self.t += self.stepper.step_of(level)
        self.ends.append(self.t)
        self.steps += 1

    def compare(self, level: int) -> bool:
        """Compare one step of `level` with two of the level below; accept the valid ones."""
        stepper, half = self.stepper, np.array([0.5])
        long_charge, long = stepper.step(self.charge, level)
        mid_charge, first = stepper.step(self.charge, level - 1)
        end_charge, second = stepper.step(mid_charge, level - 1)
        dense = stepper.sample(self.now, long, np.array([0.25, 0.5, 0.75]))
        quarters = stepper.sample(self.now, first, half), stepper.sample(first[-1], second, half)
        fine = np.vstack([quarters[0], first[-1], quarters[1]])
        scale = max(self.amplitude, float(np.abs(second[-1]).max(initial=0.0)))
        worst = max(float(np.abs(dense - fine).max()), float(np.abs(long[-1] - second[-1]).max()))
        if worst <= self.tolerance * scale:
            self.accept(long_charge, long, level)
            return True
        if level > self.level:  # the shorter steps have passed before
            self.accept(mid_charge, first, level - 1)
            self.accept(end_charge, second, level - 1)
        return False

    def take_first_step(self) -> None:
        """Shorten the first step until its error is within the tolerance."""
        while not self.compare(self.level):
            self.level -= 2 if self.level < -2 else 1
            if self.stepper.step_of(self.level) < SMALLEST * self.stepper.base:
                raise EngineError("no step is short enough for the first step of this transient")

    def advance(self, left: float) -> None:
        """Take one step, or try a longer one where enough time is left."""
        self.waited += 1
        longer = self.stepper.step_of(self.level + 1)
        if self.waited > self.patience and left > self.patience * longer:
            self.waited = 0
            if self.compare(self.level + 1):
                self.level, self.patience = self.level + 1, PATIENCE
            else:
                self.patience *= 2
            return
        charge, stages = self.stepper.step(self.charge, self.level)
        self.accept(charge, stages, self.level)

    def at(self, times: Floats) -> Floats:
        """Return the watched deviations at increasing `times` (P,), s; shape (P, K)."""
        ends = np.array(self.ends)
        which = np.clip(np.searchsorted(ends, times, side="left") - 1, 0, len(self.pieces) - 1)
        values = np.empty((len(times), len(self.now)))
        edges = np.searchsorted(which, np.arange(len(self.pieces) + 1))
        for k in np.unique(which):
            part = slice(int(edges[k]), int(edges[k + 1]))
            theta = (times[part] - ends[k]) / (ends[k + 1] - ends[k])
            start, stages = self.pieces[k]
            values[part] = self.stepper.sample(start, stages, theta)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Voltages of nodes (Q,) at instants (Q,), from the polynomials of the steps."""

    run: _Run
    rest: Floats  # the equilibrium (K,), V

    def __call__(self, times: Floats, columns: Indices) -> Floats:
        """Return voltages (Q,)."""
        instants, place = np.unique(times, return_inverse=True)
        return np.asarray(self.run.at(instants)[place, columns] + self.rest[columns])


def halved(board: LinearBoard, analysis: Transient, first: Waveforms) -> Waveforms:
    """Repeat a run of `simulate` with every step halved, at the same instants.

    A run with a smaller tolerance would take many of the same steps, since their lengths are powers
    of two, and the difference of the two runs would not show their error.

    Raises
    ------
    EngineError
        The first run is not one of `simulate`.
    """
    began, curve = clock.perf_counter(), first.curve
    if not isinstance(curve, Curve):
        raise EngineError("the first run is not one of the structured stepper")
    coarse, rest = curve.run, board.equilibrium.values
    charge = board.structure.mass @ (
        initial_unknowns(board, analysis.initial, analysis.voltages) - rest
    )
    stepper = Stepper(board.structure, coarse.stepper.watch, coarse.stepper.base)
    run = _Run(stepper, charge, coarse.pieces[0][0], coarse.tolerance)
    for level in coarse.levels:
        for _ in range(2):
            run.accept(*stepper.step(run.charge, level - 1), level - 1)
    cost = Cost(clock.perf_counter() - began, run.steps, stepper.factorisations)
    values = curve.rest + run.at(first.time)
    return replace(first, values=values, cost=cost, curve=Curve(run, curve.rest))


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float = TOLERANCE,
) -> Waveforms:
    """Simulate a large linear board.

    Parameters
    ----------
    circuit, analysis, nodes, times
        See `simulate.simulate`; the first step tried is `POINTS` times `max_step`.
    tolerance : float
        Of one step, in step amplitudes. Errors of the steps of a ringing add up over its decay.

    Raises
    ------
    EngineError
        The board is not linear, or has no equilibrium.

    Notes
    -----
    A step costs four structured solves (see `structured_solve`): 14 products of T with a vector
    and four products with inverses of size N + M.
    """
    began = clock.perf_counter()
    board = LinearBoard.of(circuit)
    if not board.circuit.is_linear:
        raise EngineError("the structured stepper is for linear boards")
    structure, reported, rest = board.structure, board.reported(nodes), board.equilibrium.values
    watch = np.array([board.descriptor.place(name) for name in reported], dtype=np.int64)
    charge = structure.mass @ (initial_unknowns(board, analysis.initial, analysis.voltages) - rest)
    stop = analysis.stop if times is None else float(times[-1])
    instants = record_times(analysis, stop) if times is None else times
    run = _run(structure, watch, charge, min(POINTS * analysis.max_step, stop), stop, tolerance)
    if times is None:
        instants = record_times(analysis, min(run.t, stop))
    values = rest[watch] + run.at(instants)
    cost = Cost(clock.perf_counter() - began, run.steps, run.stepper.factorisations + 1)
    flags = (f"the board diverges: the record ends at {run.t!r} s",) if run.t < stop else ()
    return Waveforms(
        instants, reported, values, "statespace", cost, flags,
        curve=Curve(run, rest[watch]), method=METHOD,
    )  # fmt: skip


def _run(
    structure: Structure, watch: Ints, charge: Floats, base: float, stop: float, tolerance: float
) -> _Run:
    stepper = Stepper(structure, watch, base)
    start = structure.settled_voltages(charge, 1e9 / base)[watch]
    run = _Run(stepper, charge, start, tolerance)
    if not run.amplitude > 0.0:
        run.amplitude = 1.0
    run.take_first_step()
    while run.t < stop * (1.0 - 1e-12):
        run.advance(stop - run.t)
        if float(np.abs(run.now).max(initial=0.0)) > ESCAPED * run.amplitude:
            break
    return run
