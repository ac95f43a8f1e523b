"""Transients by the state-space engine: the method that suits the board."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Cost, Floats, Waveforms
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.dense import record_times
from taction.verification.engines.statespace.transients.exact import exact_solution, is_exact

ENGINE, METHOD = "statespace", "exact"
LARGE_TOLERANCE = 1e-5  # of the outputs of a large linear board, in step amplitudes


def simulate(
    circuit: Circuit | LinearBoard,
    analysis: Transient,
    *,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    tolerance: float | None = None,
    beside: tuple[str, ...] = (),
    resolved: bool = False,
) -> Waveforms:
    """Simulate a transient: by `exact` if the board is linear and small, else by `stepped`.

    A large linear board is simulated by `reduced_transient`, if that reaches the tolerance. Of the
    analysis, `max_step` only sets the spacing of the points, and `method` is not used. The record
    of a board that leaves the range of floats ends before.

    `nodes`: by default the outputs' nodes.
    `times` (P,): requested instants, strictly increasing, s; by default uniform from 0 to `stop`.
    `tolerance`: of one step in `stepped`, of the outputs in `reduced_transient`.
    `beside`, `resolved`: see `stepped.simulate`.
    EngineError: as `exact_solution` and `stepped.simulate`; the record ends before given `times`.
    """
    board = LinearBoard.of(circuit)
    if not is_exact(board):
        from taction.verification.engines.statespace.transients import reduced_transient, stepped

        if board.circuit.is_linear:
            tolerance = LARGE_TOLERANCE if tolerance is None else tolerance
            found = reduced_transient.simulate(
                board, analysis, nodes=nodes, times=times, tolerance=tolerance
            )
            if found is not None:
                return found
        tolerance = stepped.TOLERANCE if tolerance is None else tolerance
        return stepped.simulate(
            board, analysis, nodes=nodes, times=times, tolerance=tolerance, beside=beside,
            resolved=resolved,
        )  # fmt: skip
    began = clock.perf_counter()
    initial, voltages = analysis.initial, analysis.voltages
    solution = exact_solution(board, initial=initial, voltages=voltages, nodes=nodes)
    instants = record_times(analysis, analysis.stop) if times is None else times
    values, flags = solution.at(instants), tuple[str, ...]()
    overflow = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if overflow.size:
        if times is not None or overflow[0] < 2:
            raise EngineError("the board is unstable and leaves the range of floats")
        instants, values = instants[: overflow[0]], values[: overflow[0]]
        flags = (f"the board diverges: it leaves the range of floats after {instants[-1]!r} s",)
    cost = Cost(clock.perf_counter() - began, len(instants), 1)
    return Waveforms(
        instants, solution.nodes, values, ENGINE, cost, flags, solution.error, method=METHOD
    )
