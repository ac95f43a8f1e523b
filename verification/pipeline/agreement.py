"""Comparison of the state-space engine with ngspice over all time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlist_gen.analysis import Transient
from spice_models.array_types import Floats
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.pipeline.simulation import outputs
from verification.waveforms import Waveforms

MAX_INSTANTS = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class Companion:
    """A second solution at instants of a record: from the state-space engine, or at larger steps.

    Attributes
    ----------
    instants : ndarray (Q,)
        Instants of the record, s.
    u, other : ndarray (Q, N)
        Outputs of the record and of the second solution, V; `other` is NaN if there is no
        second solution.
    share : float
        Part of a difference that is the error of the record.
    how : str
        Source of the second solution.
    reason : str
        Why the state-space engine has no solution, or empty.
    """

    instants: Floats
    u: Floats
    other: Floats
    share: float
    how: str
    reason: str = ""

    @property
    def error(self) -> float:
        """Largest error of any output at any instant, V; NaN without a second solution."""
        return self.share * float(np.abs(self.u - self.other).max(initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Differences of the outputs of two engines.

    Attributes
    ----------
    difference : float
        Largest difference of any output at any instant, V; NaN without a second solution.
    step_error : float
        Expected error of the time steps of ngspice, V.
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
    step_error: float
    time: float
    channel: int
    instants: Floats
    differences: Floats
    reason: str


def exact_companion(
    board: LinearBoard, transient: Transient, record: Waveforms, tolerance: float
) -> Companion:
    """Return the state-space solution at the instants of the `record` of ngspice.

    Parameters
    ----------
    tolerance : float
        Relative tolerance of the steps, if the state-space engine needs steps.
    """
    from verification.engines.statespace.transients.exact import simulate

    last = len(record.time) - 1  # a record without its end would prove no settling time
    shown = np.append(np.arange(0, last, max(last // MAX_INSTANTS, 1)), last)
    instants, u = np.array(record.time[shown]), outputs(board.circuit, record)[shown]
    how = "difference to the state-space engine"
    try:
        exact = simulate(board, transient, times=instants, tolerance=tolerance)
        if len(exact.time) < len(instants):
            raise EngineError("its record ends before the record of ngspice")
    except EngineError as error:
        return Companion(instants, u, np.full_like(u, np.nan), 1.0, how, str(error))
    return Companion(instants, u, outputs(board.circuit, exact), 1.0, how)


def compare_engines(companion: Companion, step_error: float) -> Agreement:
    """Compare the outputs of ngspice with those of the state-space engine.

    Parameters
    ----------
    step_error : float
        Expected error of the time steps of ngspice, V.
    """
    difference = companion.u - companion.other
    if companion.reason:
        nan = np.nan
        return Agreement(nan, nan, nan, 0, companion.instants, difference, companion.reason)
    place, channel = np.unravel_index(int(np.argmax(np.abs(difference))), difference.shape)
    return Agreement(
        difference=float(abs(difference[place, channel])),
        step_error=step_error,
        time=float(companion.instants[place]),
        channel=int(channel),
        instants=companion.instants,
        differences=difference,
        reason="",
    )
