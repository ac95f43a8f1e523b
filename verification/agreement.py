"""The second witness beside the third: the state-space engine against ngspice, over all time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.circuit import Circuit, Floats
from spice_models.errors import EngineError
from verification.crossings import lagrange
from verification.simulate import Simulation, outputs
from verification.waveforms import Waveforms

MAX_INSTANTS = 20_000
STENCIL = 4  # a cubic: more points would magnify rounding where steps grow from tiny ones


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


def compare_engines(circuit: Circuit, transient: Transient, simulation: Simulation) -> Agreement:
    """Simulate with the state-space engine what ngspice simulated, and compare the outputs.

    ngspice's answer at step zero is extrapolated from its two runs, so what is left is not the
    error of its steps.
    """
    from verification.engines.statespace import simulate

    fine, coarse = simulation.fine, simulation.coarse
    every = max(len(fine.time) // MAX_INSTANTS, 1)
    shown = slice(None, None, every)
    instants = np.asarray(fine.time[shown])
    u = outputs(circuit, fine)[shown]
    correction = np.zeros_like(u)
    if coarse is not None and len(coarse.time) >= STENCIL:
        inside = (instants >= coarse.time[0]) & (instants <= coarse.time[-1])
        instants, u = instants[inside], u[inside]
        twice = lagrange(coarse.time, outputs(circuit, coarse), instants, STENCIL)
        correction = simulation.share * (u - twice)
    nodes = tuple(output.node for output in circuit.outputs)
    try:
        exact = simulate(circuit, transient, nodes=nodes, times=instants)
    except EngineError as error:
        nothing = np.full_like(u, np.nan)
        return Agreement(np.nan, np.nan, np.nan, 0, instants, nothing, str(error))
    difference = u + correction - outputs(circuit, exact)
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


def exact_record(circuit: Circuit, transient: Transient) -> Waveforms | None:
    """Return what the state-space engine has for a transient, or None where it has no answer."""
    from verification.engines.statespace import simulate

    try:
        return simulate(circuit, transient)
    except EngineError:
        return None
