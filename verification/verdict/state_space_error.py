"""The error of a transient of the state-space engine.

The exact solution of a small linear board bounds its own rounding. Every other solution is compared
with a second one of smaller steps. The whole difference counts, and the error that the second one
can still have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients import amplified, structured_radau
from taction.verification.waveforms import Waveforms

TIGHTER = 16.0  # the first run's tolerance over the second's
ADAPTED = 0.125  # of the difference of two such runs: error of the second, at most twice the 1/15
# that follows if the error is proportional to the tolerance; the order of the method gives less
HALVED = 0.5  # of the difference to half the steps: error of the second run if it errs a third


@dataclass(frozen=True, slots=True)
class StateSpaceError:
    """The error of a record of the state-space engine.

    Attributes
    ----------
    volts : float
        Bound of the error of any output at any time, V; NaN if the second solution failed.
    rounding : float
        The part of it that no second solution shows, V; of an exact solution, all.
    second_error : float
        Bound of the error of the second solution, V.
    method, how : str
        The method of the engine, and the source of the bound.
    second : Waveforms or None
        A second solution at the instants of the record, which errs less than the record; None for
        an exact solution.
    """

    volts: float
    rounding: float
    second_error: float
    method: str
    how: str
    second: Waveforms | None = None


def is_exact(board: LinearBoard) -> bool:
    """Whether the state-space engine has the exact solution of `board`, for all time."""
    return board.circuit.is_linear and not board.descriptor.is_large


def state_space_error(
    board: LinearBoard, transient: Transient, record: Waveforms, tolerance: float
) -> StateSpaceError:
    """Bound the error of a `record` of the state-space engine, of a relative `tolerance`."""
    if is_exact(board):
        how = "bound on the rounding of the exact solution"
        return StateSpaceError(record.rounding, record.rounding, 0.0, record.method, how)
    method, rounding = record.method, record.rounding
    try:
        other, share, smaller = _second_run(board, transient, record, tolerance)
    except EngineError as error:
        how = f"the second run failed: {error}"
        return StateSpaceError(math.nan, rounding, math.nan, method, how)
    if len(other.time) < len(record.time):
        how = "the second run ends before the first"
        return StateSpaceError(math.nan, rounding, math.nan, method, how)
    apart = float(np.abs(other.values - record.values).max())
    left = share * apart + other.rounding
    how = f"difference to a run with {smaller}, and what that run and rounding leave"
    return StateSpaceError(apart + left + rounding, rounding, left, method, how, other)


def _second_run(
    board: LinearBoard, transient: Transient, record: Waveforms, tolerance: float
) -> tuple[Waveforms, float, str]:
    """Return a run with smaller steps at the instants of `record`.

    Also return the largest error that it can have, as a share of the difference, and its name.
    """
    if board.circuit.is_linear:
        return structured_radau.halved(board, transient, record), HALVED, "half the steps"
    second, nodes, times = tolerance / TIGHTER, record.nodes, record.time
    run = amplified.simulate(board, transient, nodes=nodes, times=times, tolerance=second)
    return run, ADAPTED, f"the tolerance {second:g}"
