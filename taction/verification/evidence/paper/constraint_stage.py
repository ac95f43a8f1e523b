"""Rise time of the constraint plane, the first figure of the paper.

The paper measures "the rise time of the constraint plane amplifiers" and says that the response of
the board is slower, because the resistors at a summing node form a time constant with the
capacitance of the node. This module gives two rise times: that of the amplifier alone at its noise
gain, and that of the stage with this capacitance, which may ring.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit, Output, Role
from taction.netlist_gen.board.parts import CurrentSource, Resistor
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.readings.crossings import first_above

POINTS = 4000
SPAN = 12.0  # record length in slowest time constants


@dataclass(frozen=True, slots=True)
class ConstraintPlane:
    """10-90 % rise times of the constraint stage with the largest resistive load, s.

    Attributes
    ----------
    row : int
        Number of the stage, from 1.
    amplifier_rise_time : float
        Rise time without capacitance at the summing node.
    stage_rise_time : float or None
        Rise time with this capacitance; None for a stage that is not stable by itself.
    stage_overshoot : float or None
        Overshoot with this capacitance, fraction of the step of the stage; None likewise.
    """

    row: int
    amplifier_rise_time: float
    stage_rise_time: float | None
    stage_overshoot: float | None


def constraint_plane(circuit: Circuit) -> ConstraintPlane | None:
    """Measure the step response of the constraint stage with the largest load.

    Returns None for a board without a constraint plane, and for one whose op-amps have no poles:
    its rise time is zero; also for imported op-amps, which have offsets, and input capacitances
    that cannot be left out.

    Raises
    ------
    EngineError
        The stage has no state-space form.
    """
    if circuit.has_imported or not circuit.named(Role.CONSTRAINT_RESISTOR):
        return None
    load = np.sum(1.0 / circuit.forward_ohms, axis=1)
    sinks = circuit.forward.sinks
    for part in circuit.resistors_of(Role.STRAIN_RESISTOR):
        load[sinks.index(part.b)] += 1.0 / part.ohms
    row = int(np.argmax(load)) + 1
    stage = _alone(circuit, row, float(load[row - 1]))
    bare = _without_capacitance(stage)
    if not np.isfinite(next(iter(bare.models.values())).gbw):
        return None
    (amplifier, _), rise = _rise(bare) or (0.0, 0.0), _rise(stage)
    return ConstraintPlane(row, amplifier, *(rise or (None, None)))


def _alone(circuit: Circuit, row: int, siemens: float) -> Circuit:
    """Return one constraint stage: op-amp, s, stray capacitance, all resistors as one load."""
    node = circuit.forward.sinks[row - 1]
    cells = tuple(cell for cell in circuit.opamps if cell.inverting == node)
    gains = circuit.resistors_of(Role.CONSTRAINT_RESISTOR)
    return replace(
        circuit,
        models={name: model.small_signal for name, model in circuit.models.items()},
        opamps=cells,
        amplifiers=(),
        transistors=(),
        resistors=(
            *(part for part in gains if node in (part.a, part.b)),
            Resistor("load", node, GROUND, 1.0 / siemens),
        ),
        matrices=(),
        capacitors=tuple(part for part in circuit.capacitors if part.a == node),
        currents=(CurrentSource("step", node, -1.0 / circuit.value("gain")),),
        voltages=(),
        outputs=tuple(Output(cell.output, 1.0) for cell in cells),
    )


def _without_capacitance(stage: Circuit) -> Circuit:
    models = {
        name: replace(model, input_capacitance=0.0, differential_capacitance=0.0)
        for name, model in stage.models.items()
    }
    return replace(stage, capacitors=(), models=models)


def _rise(stage: Circuit) -> tuple[float, float] | None:
    """Return rise time and overshoot of a stage; None if the stage is not stable."""
    solution = exact_solution(stage)
    if not np.all(solution.poles.real < 0.0):
        return None
    slowest = 1.0 / float(np.min(np.abs(solution.poles.real)))
    time = np.linspace(0.0, SPAN * slowest, POINTS)
    step = solution.at(time)[:, 0] / solution.final[0]
    early, late = first_above(time, step, 0.1), first_above(time, step, 0.9)
    if early is None or late is None:
        return float("nan"), 0.0
    return late.time - early.time, max(float(step.max()) - 1.0, 0.0)
