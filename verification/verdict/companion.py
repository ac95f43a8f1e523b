"""A second solution beside a record, from which its error follows, and how well both agree.

The state-space engine gives the second solution with a bound of its own error. Where it has none,
ngspice runs again at larger steps, and the whole difference of both runs counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.readings.signals import CUBIC, lagrange
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.simulation import (
    StateSpaceError,
    begin,
    is_exact,
    outputs,
    state_space_error,
    state_space_tolerance,
)
from taction.verification.verdict.transient_plan import coarser

MAX_INSTANTS = 20_000
COARSER = 2.0  # times the step: the step of a second run of ngspice


@dataclass(frozen=True, slots=True, eq=False)
class Companion:
    """A second solution for a record: from the state-space engine, or at larger steps.

    Attributes
    ----------
    instants : ndarray (Q,)
        Instants at which the record and the second solution are compared, s.
    u, other : ndarray (Q, N)
        Outputs of the record and of the second solution, V.
    solution : Waveforms
        The second solution at instants that resolve it.
    error : StateSpaceError or None
        The error of the second solution; None for a second run of ngspice at larger steps, whose
        error is larger than that of the record, so that the difference is a bound.
    how : str
        Source of the second solution.
    reason : str
        Why the state-space engine has no solution, or empty.
    """

    instants: Floats
    u: Floats
    other: Floats
    solution: Waveforms
    error: StateSpaceError | None
    how: str
    reason: str = ""

    @property
    def exact(self) -> bool:
        """Whether the second solution is from the state-space engine, with a bound of its error."""
        return not self.reason

    @property
    def doubt(self) -> float:
        """Bound of the error of the second solution where it counts, V."""
        return 0.0 if self.error is None else self.error.volts

    @property
    def difference(self) -> float:
        """Largest difference of any output at any instant, V."""
        return float(np.abs(self.u - self.other).max(initial=0.0))

    @property
    def end_error(self) -> float:
        """Bound of the error of the record's end, V."""
        return float(np.abs(self.u[-1] - self.other[-1]).max(initial=0.0)) + self.doubt


def find_companion(design: PlannedBoard, record: Waveforms) -> Companion:
    """Return a second solution for ngspice's record of a stable board.

    Raises
    ------
    SimulationError
        The state-space engine has no solution, and the second run of ngspice failed.
    """
    tolerance, board = state_space_tolerance(design.plan.wanted), design.board
    dense = None if is_exact(board) else design.plan.instants(board)
    try:
        return state_space_companion(board, design.transient, record, tolerance, dense)
    except EngineError as error:
        reason = f"no state-space solution: {error}"
    plan = replace(design.plan, transient=coarser(design.transient, COARSER))
    second = begin(replace(design, plan=plan)).result()
    inside = (second.time >= record.time[0]) & (second.time <= record.time[-1])
    instants = np.array(second.time[inside])
    u = lagrange(record.time, outputs(design.circuit, record), instants, CUBIC)
    other, how = (
        outputs(design.circuit, second)[inside],
        "whole difference to a run at twice the step",
    )
    return Companion(instants, u, other, second, None, how, reason)


def state_space_companion(
    board: LinearBoard,
    transient: Transient,
    record: Waveforms,
    tolerance: float,
    dense: Floats | None = None,
) -> Companion:
    """Return the state-space solution for the `record` of ngspice.

    Parameters
    ----------
    tolerance : float
        Relative tolerance of the steps, if the state-space engine needs steps.
    dense : ndarray, optional
        Instants, beside those of the record, that resolve the solution, s.

    Raises
    ------
    EngineError
        The state-space engine has no solution for the whole record, or none with a known error.
    """
    from taction.verification.engines.statespace.transients.simulate import simulate

    last = len(record.time) - 1  # a record without its end would prove no settling time
    shown = np.append(np.arange(0, last, max(last // MAX_INSTANTS, 1)), last)
    instants, u = np.array(record.time[shown]), outputs(board.circuit, record)[shown]
    times = instants
    if dense is not None:
        times = np.union1d(instants, dense[dense < instants[-1]])
    solution = simulate(board, transient, times=times, tolerance=tolerance)
    if len(solution.time) < len(times):
        raise EngineError("its record ends before the record of ngspice")
    error = state_space_error(board, transient, solution, tolerance)
    if not math.isfinite(error.volts):
        raise EngineError(error.how)
    how = "difference to the state-space engine, and the error of that engine"
    other = outputs(board.circuit, solution)[np.searchsorted(times, instants)]
    return Companion(instants, u, other, solution, error, how)


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Differences of the outputs of two engines.

    Attributes
    ----------
    difference : float
        Largest difference of any output at any instant, V; NaN without a second solution.
    doubt : float
        Bound of the error of the state-space engine, V.
    step_error : float
        Expected error of the time steps of ngspice, V.
    limit : float
        Largest accepted difference, fraction of the step amplitude; without a step, of `unit`.
    unit : float
        Unit voltage U0, V.
    time : float
        Instant of the largest difference, s.
    channel : int
        Channel of the largest difference, from 0.
    instants, differences : ndarray (Q,) and (Q, N)
        The differences over time, s and V.
    reason : str
        Why there is no second solution, or empty.
    """

    difference: float
    doubt: float
    step_error: float
    limit: float
    unit: float
    time: float
    channel: int
    instants: Floats
    differences: Floats
    reason: str


def compare_engines(
    companion: Companion, step_error: float, limit: float, unit: float
) -> Agreement:
    """Compare the outputs of ngspice with those of the state-space engine.

    Parameters
    ----------
    step_error : float
        Expected error of the time steps of ngspice, V.
    limit, unit : float
        See `Agreement`.
    """
    difference = companion.u - companion.other
    place, channel = np.unravel_index(int(np.argmax(np.abs(difference))), difference.shape)
    known = not companion.reason
    return Agreement(
        difference=float(abs(difference[place, channel])) if known else np.nan,
        doubt=companion.doubt,
        step_error=step_error,
        limit=limit,
        unit=unit,
        time=float(companion.instants[place]),
        channel=int(channel),
        instants=companion.instants,
        differences=difference if known else np.full_like(difference, np.nan),
        reason=companion.reason,
    )
