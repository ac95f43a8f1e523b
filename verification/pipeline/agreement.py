"""The second witness beside the third: the state-space engine against ngspice, over all time."""

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
    """Another answer at instants of a record: of the state-space engine, or at a larger step.

    Attributes
    ----------
    instants : ndarray (Q,)
        Of the record, s.
    u, other : ndarray (Q, N)
        Outputs of the record and of the other answer, V; the latter are not numbers where there
        is no other answer.
    share : float
        Part of a difference that is the record's own error.
    how : str
        How the other answer was found.
    reason : str
        Why there is no other answer, or empty.
    """

    instants: Floats
    u: Floats
    other: Floats
    share: float
    how: str
    reason: str = ""

    @property
    def error(self) -> float:
        """Largest error of any output at any instant, V; not a number without another answer."""
        return self.share * float(np.abs(self.u - self.other).max(initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How far two engines are apart.

    Attributes
    ----------
    difference : float
        Largest difference of any output at any instant, V; not a number where there was nothing
        to compare with.
    step_error : float
        What the steps of the stepping engine are expected to err by, V.
    time : float
        Where the difference is largest, s.
    channel : int
        In which channel, from 0.
    instants, differences : ndarray (Q,) and (Q, N)
        The differences over time, s and V.
    reason : str
        Why there was nothing to compare with, or empty.
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
    """Return what the state-space engine finds at the instants of ngspice's `record`.

    Parameters
    ----------
    tolerance : float
        Of the state-space engine's steps, where that engine needs steps.
    """
    from verification.engines.statespace.transients.exact import simulate

    last = len(record.time) - 1  # a record without its end would prove no settling time
    shown = np.append(np.arange(0, last, max(last // MAX_INSTANTS, 1)), last)
    instants, u = np.array(record.time[shown]), outputs(board.circuit, record)[shown]
    how = "difference to the state-space engine"
    try:
        exact = simulate(board, transient, times=instants, tolerance=tolerance)
        if len(exact.time) < len(instants):
            raise EngineError("its record ends early")
    except EngineError as error:
        return Companion(instants, u, np.full_like(u, np.nan), 1.0, how, str(error))
    return Companion(instants, u, outputs(board.circuit, exact), 1.0, how)


def compare_engines(companion: Companion, step_error: float) -> Agreement:
    """Compare the outputs of ngspice with those of the state-space engine.

    Parameters
    ----------
    step_error : float
        What the steps of ngspice are expected to err by, V.
    """
    difference = companion.u - companion.other
    if companion.reason:
        nothing = np.nan
        return Agreement(
            nothing, nothing, nothing, 0, companion.instants, difference, companion.reason
        )
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
