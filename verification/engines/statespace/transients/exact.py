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
from verification.engines.statespace.linearised.equilibrium import LARGE, equilibrium
from verification.engines.statespace.linearised.initial_state import Initial, initial_state
from verification.engines.statespace.linearised.state_space import StateSpace, linearise, modes_of
from verification.engines.statespace.transients import amplified
from verification.engines.statespace.transients.matrix_exponential import (
    Flow,
    LadderFlow,
    ModalFlow,
)
from verification.waveforms import Cost, Waveforms

ENGINE = "statespace"
CELL = 4  # unknowns that an op-amp brings, its inverting input and output among them
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


def exact(
    circuit: Circuit,
    *,
    initial: Initial = "zero",
    voltages: Mapping[str, float] | None = None,
    nodes: Iterable[str] | None = None,
    stop: float | None = None,
) -> Exact:
    """Solve a linear board exactly.

    Parameters
    ----------
    circuit : Circuit
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
    if circuit.amplifiers:
        message = f"board {circuit.name!r} has {circuit.amplifier} amplifiers: it is not linear"
        raise EngineError(message)
    space = linearise(circuit)
    wanted = tuple(nodes) if nodes is not None else tuple(o.node for o in circuit.outputs)
    C, D = space.rows(wanted)
    rest = equilibrium(space.descriptor).values
    target = space.state_of(rest)
    x0 = initial_state(space, initial, voltages)
    final = np.array([0.0 if w == "0" else rest[space.descriptor.place(w)] for w in wanted])
    modes = modes_of(space)
    flow, form = choose_flow(ModalFlow(modes, C, x0 - target), space, C, x0 - target, stop)
    share = np.zeros((space.n, len(C)), dtype=np.complex128)
    if form == "modes":
        share += modes.amplitudes(C, x0 - target).T
    start = C @ x0 + D.sum(axis=1)
    return Exact(wanted, start, final, modes.poles, share, flow.error, form, flow)


def choose_flow(
    modal: ModalFlow, space: StateSpace, C: Floats, deviation: Floats, stop: float | None
) -> tuple[Flow, Literal["modes", "exponential"]]:
    """Take the modes where their error estimate is small, else whichever estimate is smaller."""
    amplitude = float(np.abs(C @ deviation).max(initial=0.0))
    if modal.error <= TRUSTED * amplitude or not space.n:
        return modal, "modes"
    if stop is None:
        poles = np.linalg.eigvals(space.A)
        slowest = float(np.abs(poles.real).min())
        stop = 10.0 / slowest if slowest > 0.0 else 1e3 / float(np.abs(poles).max())
    ladder = LadderFlow(space.A, C, deviation, stop)
    if ladder.error < modal.error or not math.isfinite(modal.error):
        return ladder, "exponential"
    return modal, "modes"


def is_large(circuit: Circuit) -> bool:
    """Whether a board has about too many unknowns for dense matrices of all of them."""
    return CELL * len(circuit.opamps) > LARGE


def simulate(
    circuit: Circuit,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float | None = None,
) -> Waveforms:
    """Simulate a transient: exactly if the board is linear, else by `implicit.simulate`.

    A linear board of more than about `LARGE` unknowns goes through `krylov.simulate`.

    Parameters
    ----------
    circuit : Circuit
        The board.
    analysis : Transient
        `max_step` is the spacing of the points, not of steps; `method` plays no part.
    nodes : iterable of str, optional
        By default the outputs' nodes.
    times : ndarray (P,), optional
        Instants wanted, strictly increasing, s; by default uniform from 0 to `stop`.
    tolerance : float, optional
        Of one step, where there are steps, of the outputs where there is a Krylov space; by
        default as `implicit` and `krylov` have it.

    Returns
    -------
    Waveforms
        Of a board that leaves the range of floats, what comes before (an `EngineError` where
        `times` were asked for).

    Raises
    ------
    EngineError
        As `exact` and `implicit.simulate`.
    """
    if circuit.amplifiers:
        allowed = amplified.TOLERANCE if tolerance is None else tolerance
        return amplified.simulate(circuit, analysis, nodes=nodes, times=times, tolerance=allowed)
    if is_large(circuit):
        from verification.engines.statespace.transients import reduced_order

        allowed = reduced_order.TOLERANCE if tolerance is None else tolerance
        return reduced_order.simulate(
            circuit, analysis, nodes=nodes, times=times, tolerance=allowed
        )
    began = clock.perf_counter()
    solution = exact(
        circuit,
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
