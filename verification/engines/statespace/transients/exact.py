"""The exact transient of a linear board, evaluated at any instant: no time step at all."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Complexes, Floats
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.linearised.initial_state import Initial, initial_unknowns
from verification.engines.statespace.linearised.state_space import StateSpace
from verification.engines.statespace.transients import amplified
from verification.engines.statespace.transients.matrix_exponential import (
    Flow,
    LadderFlow,
    ModalFlow,
)
from verification.waveforms import Cost, Waveforms

ENGINE = "statespace"
TRUSTED = 1e-9  # modal error, in step amplitudes, below which no second way is tried


@dataclass(frozen=True, slots=True, eq=False)
class Exact:
    """Node voltages of a linear board as functions of time, t >= 0.

    Attributes
    ----------
    nodes : tuple of str
        K of them.
    start, final : ndarray (K,)
        Just after the strain steps on, and at the equilibrium (reached or not), V.
    poles : ndarray (n,)
        1/s, rightmost first.
    share : ndarray (n, K)
        Modal amplitudes, V; zero where the modes are not used.
    error : float
        Bound on the rounding error of any node at any time, V, to first order.
    form : str
        ``"modes"``, or ``"exponential"`` where modes are defective or ill-conditioned.
    """

    nodes: tuple[str, ...]
    start: Floats
    final: Floats
    poles: Complexes
    share: Complexes
    error: float
    form: Literal["modes", "exponential"]
    flow: Flow

    def at(self, times: Floats) -> Floats:
        """Voltages at `times` (P,), s; shape (P, K)."""
        return self.final + self.flow.at(np.asarray(times, dtype=np.float64))

    def derivative(self, times: Floats) -> Floats:
        """Time derivatives at `times` (P,), V/s; shape (P, K)."""
        return self.flow.at(np.asarray(times, dtype=np.float64), order=1)

    def uniform(self, step: float, count: int) -> Floats:
        """Voltages at ``step * (0 .. count - 1)``; shape (count, K)."""
        if isinstance(self.flow, ModalFlow):
            return self.final + self.flow.uniform(step, count)
        return self.at(np.arange(count) * np.float64(step))


def exact_solution(
    circuit: Circuit | LinearBoard,
    *,
    initial: Initial = "zero",
    voltages: Mapping[str, float] | None = None,
    nodes: Iterable[str] | None = None,
    stop: float | None = None,
) -> Exact:
    """Solve a linear board exactly.

    Parameters
    ----------
    circuit : Circuit or LinearBoard
        Without behavioural amplifiers.
    initial, voltages
        As `netlist_gen.analysis.Transient` has them.
    nodes : iterable of str, optional
        By default the outputs' nodes.
    stop : float, optional
        Latest instant of interest, s; needed only where modes cannot be used. By default ten
        time constants of the slowest mode.

    Raises
    ------
    EngineError
        The board is not linear, has no equilibrium or no state space.

    Notes
    -----
    Costs one dense eigenproblem (25 n³ flops); an instant then costs n multiplications a node.
    """
    board = LinearBoard.of(circuit)
    if board.circuit.amplifiers:
        message = f"board {board.circuit.name!r} has {board.circuit.amplifier} amplifiers: it is \
not linear"
        raise EngineError(message)
    space, wanted = board.state_space, board.reported(nodes)
    C, D = space.rows(wanted)
    x0 = space.state_of(initial_unknowns(board, initial, voltages))
    deviation = x0 - space.state_of(board.equilibrium.values)
    flow, form = _choose_flow(space, C, deviation, stop)
    share = np.zeros((space.n, len(C)), dtype=np.complex128)
    if form == "modes":
        share += space.modes.amplitudes(C, deviation).T
    start, final = C @ x0 + D.sum(axis=1), np.array([board.equilibrium[node] for node in wanted])
    return Exact(wanted, start, final, space.modes.poles, share, flow.error, form, flow)


def _choose_flow(
    space: StateSpace, C: Floats, deviation: Floats, stop: float | None
) -> tuple[Flow, Literal["modes", "exponential"]]:
    """Take the modes where their error estimate is small, else whichever estimate is smaller."""
    modal = ModalFlow(space.modes, C, deviation)
    amplitude = float(np.abs(C @ deviation).max(initial=0.0))
    if modal.error <= TRUSTED * amplitude or not space.n:
        return modal, "modes"
    if stop is None:
        poles = space.modes.poles
        slowest = float(np.abs(poles.real).min())
        stop = 10.0 / slowest if slowest > 0.0 else 1e3 / float(np.abs(poles).max())
    ladder = LadderFlow(space.A, C, deviation, stop)
    if ladder.error < modal.error or not math.isfinite(modal.error):
        return ladder, "exponential"
    return modal, "modes"


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float | None = None,
) -> Waveforms:
    """Simulate a transient: exactly if the board is linear, else by `amplified.simulate`.

    A large linear board goes through `reduced_order.simulate`.

    Parameters
    ----------
    circuit : Circuit or LinearBoard
        The board.
    analysis : Transient
        `max_step` is the spacing of the points, not of steps; `method` plays no part.
    nodes : iterable of str, optional
        By default the outputs' nodes.
    times : ndarray (P,), optional
        Instants wanted, strictly increasing, s; by default uniform from 0 to `stop`.
    tolerance : float, optional
        Of one step, where there are steps, of the outputs where there is a Krylov space; by
        default as `amplified` and `reduced_order` have it.

    Returns
    -------
    Waveforms
        Of a board that leaves the range of floats, what comes before (an `EngineError` where
        `times` were asked for).

    Raises
    ------
    EngineError
        As `exact_solution` and `amplified.simulate`.
    """
    began, board = clock.perf_counter(), LinearBoard.of(circuit)
    if board.circuit.amplifiers or board.descriptor.is_large:
        from verification.engines.statespace.transients import reduced_order

        run = amplified.simulate if board.circuit.amplifiers else reduced_order.simulate
        allowed = {} if tolerance is None else {"tolerance": tolerance}
        return run(board, analysis, nodes=nodes, times=times, **allowed)
    solution = exact_solution(
        board,
        initial=analysis.initial,
        voltages=analysis.voltages,
        nodes=nodes,
        stop=analysis.stop if times is None else float(times[-1]),
    )
    uniform = times is None
    if times is None:
        solved = amplified.record_times(analysis, analysis.stop)
        values = solution.uniform(float(solved[1]), len(solved))
    else:
        solved, values = times, solution.at(times)
    flags: tuple[str, ...] = ()
    lost = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if lost.size:
        if not uniform or lost[0] < 2:
            raise EngineError("the board is unstable and leaves the range of floats")
        solved, values = solved[: lost[0]], values[: lost[0]]
        flags = (f"the board diverges: it leaves the range of floats after {solved[-1]!r} s",)
    cost = Cost(clock.perf_counter() - began, len(solved), 1)
    return Waveforms(solved, solution.nodes, values, ENGINE, cost, flags, solution.error)
