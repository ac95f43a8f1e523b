"""The exact transient of a linear board, evaluated at any instant without time steps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import EPS, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import (
    Initial,
    LinearBoard,
    initial_unknowns,
)
from taction.verification.engines.statespace.transients.matrix_exponential import ModalFlow


def is_exact(board: LinearBoard) -> bool:
    """Whether the state-space engine has the exact solution of `board`, for all time."""
    return board.circuit.is_linear and not board.descriptor.is_large


@dataclass(frozen=True, slots=True, eq=False)
class Exact:
    """Node voltages of a linear board as functions of time, t >= 0.

    Attributes
    ----------
    start, final : ndarray (K,)
        Just after the strain step, and at the equilibrium (reached or not), V.
    poles : ndarray (n,)
        1/s, rightmost first.
    rest_error : ndarray (K,)
        Bound on the rounding error of `final`, V.
    """

    nodes: tuple[str, ...]
    start: Floats
    final: Floats
    poles: Complexes
    rest_error: Floats
    flow: ModalFlow

    @property
    def error(self) -> float:
        """Bound on the rounding error of any node at any time, V, to first order."""
        return self.flow.error + float(self.rest_error.max(initial=0.0))

    def columns(self, chosen: Ints) -> Exact:
        """Return the solution of some nodes."""
        return replace(
            self,
            nodes=tuple(self.nodes[k] for k in chosen.tolist()),
            start=self.start[chosen],
            final=self.final[chosen],
            rest_error=self.rest_error[chosen],
            flow=self.flow.columns(chosen),
        )

    def bounds(self, times: Floats) -> Floats:
        """Return bounds on the rounding error at `times` (P,), V, to first order; shape (P, K)."""
        return self.flow.bounds(np.asarray(times, dtype=np.float64)) + self.rest_error

    def at(self, times: Floats) -> Floats:
        """Return voltages at `times` (P,), s; shape (P, K)."""
        return self.final + self.flow.at(np.asarray(times, dtype=np.float64))

    def derivative(self, times: Floats) -> Floats:
        """Return time derivatives at `times` (P,), V/s; shape (P, K)."""
        return self.flow.at(np.asarray(times, dtype=np.float64), order=1)

    def uniform(self, step: float, count: int) -> Floats:
        """Return voltages at ``step * (0 .. count - 1)``; shape (count, K)."""
        return self.final + self.flow.uniform(step, count)


def exact_solution(
    circuit: Circuit | LinearBoard,
    *,
    initial: Initial = "zero",
    voltages: Mapping[str, float] | None = None,
    nodes: Iterable[str] | None = None,
    linearised: bool = False,
) -> Exact:
    """Solve a linear board exactly.

    `circuit`: the board, without behavioural amplifiers.
    `initial`, `voltages`: see `taction.netlist_gen.analysis.Transient`.
    `nodes`: by default the outputs' nodes.
    `linearised`: whether a board with behavioural amplifiers may stand for its linearisation.
    EngineError: the board is not linear, or has no equilibrium or no state space, or rounding hides
      the solution.

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
    if not voltages and nodes is None:  # one verification uses it several times
        known = _OUTPUTS.setdefault(board, {})
        if initial not in known:
            known[initial] = _solve(board, initial, None, board.reported(None))
        return known[initial]
    return _solve(board, initial, voltages, board.reported(nodes))


_OUTPUTS: WeakKeyDictionary[LinearBoard, dict[Initial, Exact]] = WeakKeyDictionary()
"""Solutions of the outputs of boards that are in use."""


def _solve(
    board: LinearBoard,
    initial: Initial,
    voltages: Mapping[str, float] | None,
    reported: tuple[str, ...],
) -> Exact:
    space = board.state_space
    C, D = space.rows(reported)
    begin = initial_unknowns(board, initial, voltages)
    start = C @ space.state_of(begin) + D.sum(axis=1)
    final, rest_error = _at_rest(board, reported)
    doubt = _unseen(board, reported)
    return _exact(board, reported, C, begin, doubt, start, final, rest_error)


def _unseen(board: LinearBoard, reported: tuple[str, ...]) -> Floats:
    """Return bounds on the errors of the modes in the rows of nodes, (K, n)."""
    unseen, descriptor = board.state_space.modes.unseen, board.descriptor
    rows = [0.0 * unseen[0] if n == "0" else unseen[descriptor.place(n)] for n in reported]
    return np.array(rows).reshape(len(reported), unseen.shape[1])


def _at_rest(board: LinearBoard, reported: tuple[str, ...]) -> tuple[Floats, Floats]:
    """Return the voltages of the equilibrium and bounds of their rounding, V, (K,)."""
    final, off = np.zeros((2, len(reported)))
    live = [k for k, node in enumerate(reported) if node != "0"]
    places = [board.descriptor.place(reported[k]) for k in live]
    final[live], off[live] = board.equilibrium.values[places], board.rounding[places]
    return final, off + EPS * np.abs(final)


def _exact(
    board: LinearBoard,
    names: tuple[str, ...],
    C: Floats,
    begin: Floats,
    doubt: Floats,
    start: Floats,
    final: Floats,
    rest_error: Floats,
) -> Exact:
    """Return ``final + C exp(A t)`` times the deviation of the unknowns `begin` from rest."""
    modes = board.state_space.modes
    flow = ModalFlow(modes, C, begin - board.equilibrium.values, doubt)
    if not flow.error < math.inf:
        raise EngineError("rounding hides the solution")
    return Exact(names, start, final, modes.poles, rest_error, flow)


def combinations(
    board: LinearBoard,
    nodes: tuple[str, ...],
    volts: Floats,
    rates: Floats,
    *,
    initial: Initial = "zero",
) -> Exact:
    """Solve for ``volts @ V + rates @ dV/dt`` of a linear board, V the voltages of `nodes`.

    `nodes`: nodes, or states of op-amps by their names in the descriptor.
    `volts`, `rates` (K, n): weights of the voltages (1/V) and of their time derivatives (s/V). The
      start is just after the strain step, so jumps at that instant have no derivative.
    EngineError: as `exact_solution`.

    Returns
    -------
    Exact
        Its "nodes" are the numbers of the combinations.
    """
    space = board.state_space
    C, D = space.rows(nodes)
    begin = initial_unknowns(board, initial, None)
    x0 = space.state_of(begin)
    moving = rates @ C @ space.A
    rest, error = _at_rest(board, nodes)
    final = volts @ rest
    moved = moving @ (x0 - space.state_of(board.equilibrium.values))
    start = volts @ (C @ x0 + D.sum(axis=1)) + moved
    names = tuple(map(str, range(len(volts))))
    unseen, speed = _unseen(board, nodes), np.abs(space.modes.centres)
    doubt = np.abs(volts) @ unseen + (np.abs(rates) @ unseen) * speed
    rows, off = volts @ C + moving, np.abs(volts) @ error
    return _exact(board, names, rows, begin, doubt, start, final, off)
