"""The second witness beside the third: the state-space engine against ngspice, over all time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Floats
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.measures.resampling import CUBIC, lagrange
from verification.pipeline.simulation import Simulation, outputs
from verification.waveforms import Waveforms

MAX_INSTANTS = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How far two engines are apart.

    Attributes
    ----------
    difference : float
        Largest difference of any output at any instant, V, with the stepping engine extrapolated
        to step zero; not a number where there was nothing to compare with.
    step_error : float
        What the extrapolation took away: the stepping engine's own error, V.
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


@dataclass(frozen=True, slots=True, eq=False)
class Other:
    """The state-space engine's answer at instants of the stepping engine's second run.

    Attributes
    ----------
    instants : ndarray (Q,)
        s.
    second : ndarray (Q, N)
        What the second run has there, V.
    exact : ndarray (Q, N)
        What the state-space engine has there, V; not numbers where it has no answer.
    reason : str
        Why it has no answer, or empty.
    """

    instants: Floats
    second: Floats
    exact: Floats
    reason: str


def other_engine(board: LinearBoard, transient: Transient, second: Waveforms) -> Other:
    """Simulate with the state-space engine what ngspice simulates.

    The instants are those of ngspice's second run, which ends while the first is under way.
    """
    from verification.engines.statespace.transients.exact import simulate

    shown = slice(None, None, max(len(second.time) // MAX_INSTANTS, 1))
    instants = np.asarray(second.time[shown])
    u = outputs(board.circuit, second)[shown]
    try:
        exact = simulate(board, transient, times=instants)
    except EngineError as error:
        return Other(instants, u, np.full_like(u, np.nan), str(error))
    return Other(instants, u, outputs(board.circuit, exact), "")


def compare_engines(circuit: Circuit, simulation: Simulation, other: Other) -> Agreement:
    """Compare the outputs that ngspice and the state-space engine find.

    ngspice's answer at step zero is extrapolated from its two runs, so what is left is not the
    error of its steps.
    """
    fine, instants = simulation.fine, other.instants
    if other.reason or len(fine.time) < CUBIC:
        reason = other.reason or f"the record has {len(fine.time)} points"
        return Agreement(np.nan, np.nan, np.nan, 0, instants, other.exact * np.nan, reason)
    inside = (instants >= fine.time[0]) & (instants <= fine.time[-1])
    instants = instants[inside]
    u = lagrange(fine.time, outputs(circuit, fine), instants, CUBIC)
    correction = simulation.share * (u - other.second[inside])
    difference = u + correction - other.exact[inside]
    place, channel = np.unravel_index(int(np.argmax(np.abs(difference))), difference.shape)
    return Agreement(
        difference=float(abs(difference[place, channel])),
        step_error=float(np.max(np.abs(correction))),
        time=float(instants[place]),
        channel=int(channel),
        instants=instants,
        differences=difference,
        reason="",
    )


def exact_record(board: LinearBoard, transient: Transient) -> Waveforms | None:
    """Return what the state-space engine has for a transient, or None where it has no answer."""
    from verification.engines.statespace.transients.exact import simulate

    try:
        return simulate(board, transient)
    except EngineError:
        return None
