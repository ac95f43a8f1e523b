"""The exact transient of a linear board, evaluated at any instant without time steps."""

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
TRUSTED = 1e-9  # modal error, in step amplitudes, below which the matrix exponential is not tried


@dataclass(frozen=True, slots=True, eq=False)
class Exact:
    """Node voltages of a linear board as functions of time, t >= 0.

    Attributes
    ----------
    start, final : ndarray (K,)
        Just after the strain step, and at the equilibrium (reached or not), V.
    poles : ndarray (n,)
        1/s, rightmost first.
    share : ndarray (n, K)
        Modal amplitudes, V; zero where the modes are not used.
    error : float
        Bound on the rounding error of any node at any time, V, to first order.
    form : str
        ``"exponential"`` (of the matrix) where modes are defective or ill-conditioned.
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
        """Return voltages at `times` (P,), s; shape (P, K)."""
        return self.final + self.flow.at(np.asarray(times, dtype=np.float64))

    def derivative(self, times: Floats) -> Floats:
        """Return time derivatives at `times` (P,), V/s; shape (P, K)."""
        return self.flow.at(np.asarray(times, dtype=np.float64), order=1)

    def uniform(self, step: float, count: int) -> Floats:
        """Return voltages at ``step * (0 .. count - 1)``; shape (count, K)."""
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
    linearised: bool = False,
) -> Exact:
    """Solve a linear board exactly.

    Parameters
    ----------
    circuit : Circuit or LinearBoard
        The board, without behavioural amplifiers.
    initial, voltages
        See `netlist_gen.analysis.Transient`.
    nodes : iterable of str, optional
        By default the outputs' nodes.
    stop : float, optional
        Latest instant of interest, s; needed only where modes cannot be used. By default ten
        time constants of the slowest mode.
    linearised : bool
        Whether a board with behavioural amplifiers may stand for its linearisation.

    Raises
    ------
    EngineError
        The board is not linear, or has no equilibrium or no state space.

    Notes
    -----
    Costs one dense eigenproblem (25 n³ flops), and n multiplications for each node and instant.
    """
    board = LinearBoard.of(circuit)
    if board.circuit.amplifiers and not linearised:
        name, kind = board.circuit.name, board.circuit.amplifier
        raise EngineError(f"board {name!r} has {kind} amplifiers: the board is not linear")
    space, reported = board.state_space, board.reported(nodes)
    C, D = space.rows(reported)
    x0 = space.state_of(initial_unknowns(board, initial, voltages))
    deviation = x0 - space.state_of(board.equilibrium.values)
    flow, form = _choose_flow(space, C, deviation, stop)
    share = np.zeros((space.n, len(C)), dtype=np.complex128)
    if form == "modes":
        share += space.modes.amplitudes(C, deviation).T
    start, final = C @ x0 + D.sum(axis=1), np.array([board.equilibrium[node] for node in reported])
    return Exact(reported, start, final, space.modes.poles, share, flow.error, form, flow)


def _choose_flow(
    space: StateSpace, C: Floats, deviation: Floats, stop: float | None
) -> tuple[Flow, Literal["modes", "exponential"]]:
    """Return the modal flow if its error is small, else the flow with the smaller error."""
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

    A large linear board is simulated by `reduced_order.simulate`.

    Parameters
    ----------
    circuit : Circuit or LinearBoard
        The board.
    analysis : Transient
        `max_step` only sets the spacing of the points; `method` is not used.
    nodes : iterable of str, optional
        By default the outputs' nodes.
    times : ndarray (P,), optional
        Requested instants, strictly increasing, s; by default uniform from 0 to `stop`.
    tolerance : float, optional
        Of one step in `amplified`, of the outputs in `reduced_order`; by default theirs.

    Returns
    -------
    Waveforms
        The record of a board that leaves the range of floats ends before (with given `times`, an
        `EngineError` is raised).

    Raises
    ------
    EngineError
        As `exact_solution` and `amplified.simulate`.
    """
    began, board = clock.perf_counter(), LinearBoard.of(circuit)
    if board.circuit.amplifiers or board.descriptor.is_large:
        from verification.engines.statespace.transients import reduced_order

        run = amplified.simulate if board.circuit.amplifiers else reduced_order.simulate
        given = {} if tolerance is None else {"tolerance": tolerance}
        return run(board, analysis, nodes=nodes, times=times, **given)
    solution = exact_solution(
        board,
        initial=analysis.initial,
        voltages=analysis.voltages,
        nodes=nodes,
        stop=analysis.stop if times is None else float(times[-1]),
    )
    if times is None:
        instants = amplified.record_times(analysis, analysis.stop)
        values = solution.uniform(float(instants[1]), len(instants))
    else:
        instants, values = times, solution.at(times)
    flags: tuple[str, ...] = ()
    overflow = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if overflow.size:
        if times is not None or overflow[0] < 2:
            raise EngineError("the board is unstable and leaves the range of floats")
        instants, values = instants[: overflow[0]], values[: overflow[0]]
        flags = (f"the board diverges: it leaves the range of floats after {instants[-1]!r} s",)
    cost = Cost(clock.perf_counter() - began, len(instants), 1)
    return Waveforms(instants, solution.nodes, values, ENGINE, cost, flags, solution.error)
