"""The error of a transient of the state-space engine.

The exact solution of a small linear board bounds its own rounding. Every other solution is compared
with a second one, whose error is larger or of another kind; the whole difference counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from netlist_gen.analysis import Transient
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients import amplified, structured_radau
from verification.waveforms import Waveforms

LOOSER = 4.0  # the second run's tolerance over the first's: it then errs 2 to 7 times as much


@dataclass(frozen=True, slots=True)
class StateSpaceError:
    """The error of a record of the state-space engine.

    Attributes
    ----------
    volts : float
        Bound of the error of any output at any time, V; NaN if the second solution failed.
    rounding : float
        The part of it that no second solution shows, V; of an exact solution, all.
    method, how : str
        The method of the engine, and the source of the bound.
    second : Waveforms or None
        A second solution at the instants of the record, which errs more than the record; None for
        an exact solution.
    """

    volts: float
    rounding: float
    method: str
    how: str
    second: Waveforms | None = None


def is_exact(board: LinearBoard) -> bool:
    """Whether the state-space engine has the exact solution of `board`, for all time."""
    return not (board.circuit.amplifiers or board.descriptor.is_large)


def state_space_error(
    board: LinearBoard, transient: Transient, record: Waveforms, tolerance: float
) -> StateSpaceError:
    """Bound the error of a `record` of the state-space engine, of a relative `tolerance`."""
    if is_exact(board):
        how = "bound on the rounding of the exact solution"
        return StateSpaceError(record.rounding, record.rounding, "exact", how)
    amplifiers = bool(board.circuit.amplifiers)
    run = amplified.simulate if amplifiers else structured_radau.simulate
    method = "implicit, adaptive" if amplifiers else "implicit, structured"
    second = LOOSER * tolerance
    nodes, times, rounding = record.nodes, record.time, record.rounding
    try:
        other = run(board, transient, nodes=nodes, times=times, tolerance=second)
    except EngineError as error:
        return StateSpaceError(math.nan, rounding, method, f"the second run failed: {error}")
    if len(other.time) < len(times):
        return StateSpaceError(math.nan, rounding, method, "the second run ends before the first")
    apart = float(np.abs(other.values - record.values).max())
    how = f"difference to a run with the tolerance {second:g}, and rounding: an upper bound"
    return StateSpaceError(apart + rounding, rounding, method, how, other)
