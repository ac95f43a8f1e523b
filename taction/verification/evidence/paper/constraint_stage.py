"""Rise time of the constraint plane, the first figure of the paper.

The paper measures "the rise time of the constraint plane amplifiers" and says that the response of
the board is slower, because the resistors at a summing node form a time constant with the
capacitance of the node. This module gives two rise times: that of the amplifier alone at its noise
gain, and that of the stage with this capacitance, which may ring. Both follow from the transfer
function of a two-pole op-amp, of Kirchhoff's laws and numpy alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from taction.netlist_gen.board.circuit import Circuit, Role

POINTS = 40_000
SPAN = 12.0  # record length in slowest time constants


@dataclass(frozen=True, slots=True)
class ConstraintPlane:
    """10-90 % rise times, s, of the constraint stage with the largest resistive load.

    Those with the capacitance at the summing node are None for a stage that is not stable by
    itself.
    """

    row: int  # number of the stage, from 1
    amplifier_rise_time: float  # without capacitance at the summing node
    stage_rise_time: float | None
    stage_overshoot: float | None  # fraction of the step of the stage


def constraint_plane(circuit: Circuit) -> ConstraintPlane:
    """Return the step response of the constraint stage with the largest load.

    With r the output resistance over s, Y the admittance of the node and D = (1 + s A0/wt)(1 + s
    t2) of the op-amp, the output over the current is (r D - A0) / ((1 + r) Y D + (D + A0)/s).
    """
    load = np.sum(1.0 / circuit.forward_ohms, axis=1)
    sinks = circuit.forward.sinks
    for part in circuit.resistors_of(Role.STRAIN_RESISTOR):
        load[sinks.index(part.b)] += 1.0 / part.ohms
    row = int(np.argmax(load))
    strays = (part.farads for part in circuit.capacitors if part.a == sinks[row])
    (model,) = circuit.models.values()
    farads = math.fsum((*strays, model.input_capacitance, model.differential_capacitance))
    siemens = float(load[row]) + 1.0 / model.input_resistance
    wt, gain, A0 = math.tau * model.gbw, circuit.value("gain"), model.dc_gain
    D = Polynomial([1.0, A0]) * Polynomial([1.0, model.gbw / model.second_pole])  # time times wt
    r = model.output_resistance / gain

    def rise(farads: float) -> tuple[float, float] | None:
        Y = Polynomial([siemens, wt * farads]) if farads else Polynomial([siemens])
        found = _rise(r * D - A0, (1.0 + r) * Y * D + (D + A0) / gain)
        return None if found is None else (found[0] / wt, found[1])

    (amplifier, _), stage = rise(0.0) or (math.nan, 0.0), rise(farads)
    return ConstraintPlane(row + 1, amplifier, *(stage or (None, None)))


def _rise(above: Polynomial, below: Polynomial) -> tuple[float, float] | None:
    """Return rise time and overshoot of the step of a transfer function; None if it grows."""
    poles = np.asarray(below.trim().roots(), dtype=np.complex128)
    if not np.all(poles.real < 0.0):
        return None
    time = np.linspace(0.0, SPAN / float(np.min(np.abs(poles.real))), POINTS)
    parts = above(poles) / (poles * below.deriv()(poles))
    final = above(0.0) / below(0.0)
    step = 1.0 + (np.exp(time[:, None] * poles) @ parts).real / final
    early, late = (_first(time, step, level) for level in (0.1, 0.9))
    return late - early, max(float(step.max()) - 1.0, 0.0)


def _first(time: np.ndarray, step: np.ndarray, level: float) -> float:
    """Return when the step first passes a level, on the line between two points."""
    k = int(np.argmax(step > level))
    return float(np.interp(level, step[k - 1 : k + 1], time[k - 1 : k + 1]))
