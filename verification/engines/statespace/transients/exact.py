"""The exact transient of a linear board, evaluated at any instant without time steps."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import EPS, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import (
    Initial,
    LinearBoard,
    initial_unknowns,
)
from taction.verification.engines.statespace.linearised.state_space import StateSpace
from taction.verification.engines.statespace.transients.matrix_exponential import (
    Flow,
    LadderFlow,
    ModalFlow,
)

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
    rest_error : ndarray (K,)
        Bound on the rounding error of `final`, V.
    form : str
        ``"exponential"`` (of the matrix) where modes are defective or ill-conditioned.
    """

    nodes: tuple[str, ...]
    start: Floats
    final: Floats
    poles: Complexes
    share: Complexes
    rest_error: Floats
    form: Literal["modes", "exponential"]
    flow: Flow

    @property
    def error(self) -> float:
        """Bound on the rounding error of any node at any time, V, to first order."""
        return self.flow.error + float(self.rest_error.max(initial=0.0))

    def bounds(self, times: Floats) -> Floats:
        """Return bounds on the rounding error at `times` (P,), V, to first order; shape (P, K)."""
        return self.flow.bounds(np.asarray(times, dtype=np.float64)) + self.rest_error

    def part(self, columns: Ints) -> Exact:
        """Return the solution of some nodes."""
        return replace(
            self,
            nodes=tuple(self.nodes[k] for k in columns.tolist()),
            start=self.start[columns],
            final=self.final[columns],
            share=self.share[:, columns],
            rest_error=self.rest_error[columns],
            flow=self.flow.part(columns),
        )

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
        See `taction.netlist_gen.analysis.Transient`.
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
        The board is not linear, or has no equilibrium or no state space, or rounding hides the
        solution.

    Notes
    -----
    Costs one dense eigenproblem (25 n³ flops), and n multiplications for each node and instant.
    """
    board = LinearBoard.of(circuit)
    if not (board.circuit.is_linear or linearised):
        name, kind = board.circuit.name, board.circuit.amplifier
        nonlinear = board.circuit.has_nonlinear_amplifiers
        what = f"{kind} amplifiers" if nonlinear else "op-amps with limits"
        raise EngineError(f"board {name!r} has {what}: the board is not linear")
    if not voltages and nodes is None:
        return _outputs_solution(board, initial, stop)
    return _solve(board, initial, voltages, board.reported(nodes), stop)


@functools.lru_cache(maxsize=4)
def _outputs_solution(board: LinearBoard, initial: Initial, stop: float | None) -> Exact:
    """Return the solution of the outputs, which one verification uses several times."""
    return _solve(board, initial, None, board.reported(None), stop)


def _solve(
    board: LinearBoard,
    initial: Initial,
    voltages: Mapping[str, float] | None,
    reported: tuple[str, ...],
    stop: float | None,
) -> Exact:
    space = board.state_space
    C, D = space.rows(reported)
    x0 = space.state_of(initial_unknowns(board, initial, voltages))
    deviation = x0 - space.state_of(board.equilibrium.values)
    start = C @ x0 + D.sum(axis=1)
    final, rest_error = _at_rest(board, reported)
    return _exact(board, reported, C, deviation, start, final, rest_error, stop)


def _at_rest(board: LinearBoard, reported: tuple[str, ...]) -> tuple[Floats, Floats]:
    """Return the voltages of the equilibrium and bounds of their rounding, V, (K,)."""
    final = np.array([board.equilibrium[node] for node in reported])
    off = [
        0.0 if node == "0" else board.rounding[board.descriptor.place(node)] for node in reported
    ]
    return final, np.array(off) + EPS * np.abs(final)


def _exact(
    board: LinearBoard,
    names: tuple[str, ...],
    C: Floats,
    deviation: Floats,
    start: Floats,
    final: Floats,
    rest_error: Floats,
    stop: float | None,
) -> Exact:
    """Return ``final + C exp(A t) deviation``, with the modal amplitudes where they are used."""
    space = board.state_space
    flow, form = _choose_flow(space, C, deviation, stop)
    share = np.zeros((space.n, len(C)), dtype=np.complex128)
    if form == "modes":
        share += space.modes.amplitudes(C, deviation).T
    return Exact(names, start, final, space.modes.poles, share, rest_error, form, flow)


def combinations(
    board: LinearBoard,
    nodes: tuple[str, ...],
    volts: Floats,
    rates: Floats,
    *,
    initial: Initial = "zero",
    stop: float | None = None,
) -> Exact:
    """Solve for ``volts @ V + rates @ dV/dt`` of a linear board, V the voltages of `nodes`.

    Parameters
    ----------
    nodes : tuple of str (n,)
        Nodes, or states of op-amps by their names in the descriptor.
    volts, rates : ndarray (K, n)
        Weights of the voltages (1/V) and of their time derivatives (s/V). The start is just after
        the strain step, so jumps at that instant have no derivative.

    Returns
    -------
    Exact
        Its "nodes" are the numbers of the combinations.

    Raises
    ------
    EngineError
        As `exact_solution`.
    """
    space = board.state_space
    C, D = space.rows(nodes)
    x0 = space.state_of(initial_unknowns(board, initial, None))
    deviation = x0 - space.state_of(board.equilibrium.values)
    rows = volts @ C + rates @ C @ space.A
    rest, error = _at_rest(board, nodes)
    final = volts @ rest
    start = volts @ (C @ x0 + D.sum(axis=1)) + (rates @ C @ space.A) @ deviation
    names = tuple(map(str, range(len(volts))))
    return _exact(board, names, rows, deviation, start, final, np.abs(volts) @ error, stop)


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
    if not min(ladder.error, modal.error) < math.inf:
        raise EngineError(f"rounding hides the solution over {show(stop, 's', 3)}")
    return (ladder, "exponential") if ladder.error < modal.error else (modal, "modes")
