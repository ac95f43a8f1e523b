"""What a verdict says beside its checks: warnings, and whether its witnesses are of one problem."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.part_warnings import part_warnings, stuck_cells
from taction.netlist_gen.scene.axes import questions
from taction.spice_models.input_errors import not_known
from taction.system.array_types import Floats
from taction.system.quantities import show, spaced
from taction.system.reading_definitions import READINGS
from taction.verification.engines.ngspice.executable import missing_simulator
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.checks import Evidence

FAINTLY = 1e-3  # damping ratio below which a board nearly oscillates
NEARLY = (
    "damping ratio {:.2g}: the board nearly oscillates; component tolerances can make it oscillate"
)
IMPORTED = (
    "op-amp {} is imported: the state-space engine has its cards, linear about their rest, within"
    " {:.2g} % of ngspice's small signal up to {}"
)


def all_warnings(evidence: Evidence) -> tuple[str, ...]:
    """Return the warnings of the scene, the parts, the plan, the engine and the readings."""
    notes, run = list[str](), evidence.run
    if run is not None:
        board, circuit = run.board, run.board.circuit
        rest = board.linear.equilibrium.__getitem__ if board.poles.known_stable else None
        notes += (*questions(board.scene), *run.ends.flags, *board.plan.notes)
        auto = board.scene.analysis.engine == "auto" and board.engine == "statespace"
        if auto and (missing := missing_simulator()):
            notes.append(f"by taction's own engine alone, without ngspice: {missing}")
        notes += (*part_warnings(circuit, rest), *stuck_cells(circuit))
        for name, model in circuit.models.items():
            if model.imported is not None and (linear := model.imported.linear) is not None:
                band = show(linear.band[1], "Hz", 3)
                notes.append(IMPORTED.format(name, 100.0 * linear.error, band))
        notes += not_known(circuit.models.values())
    if not evidence.poles.known_stable:
        return tuple(notes)
    if (damping := evidence.poles.damping_ratio) < FAINTLY:
        notes.append(NEARLY.format(damping))
    for channel in evidence.measurements.channels:
        for name, reading in channel.fragile.items():
            if reading.alternative is not None:
                unit, shifted = READINGS[name].unit, READINGS[name].shifted
                value, other = show(reading.value, unit), show(reading.alternative, unit)
                place = f"channel {channel.index + 1}: {spaced(name)}"
                notes.append(f"{place} {value} is fragile: {other} with {shifted}")
    return tuple(notes)


def missing_witness(circuit: Circuit, engine: str) -> str:
    """Return which of the two witnesses a board with imported op-amps lacks; empty for none."""
    for name, model in circuit.models.items():
        if (imported := model.imported) is None:
            continue
        if imported.linear is None:
            return f"op-amp {name} has no state-space witness: {imported.missing}"
        if engine != "ngspice":
            return f"the slew rate and limits of op-amp {name} are in its netlist: run ngspice"
    return ""


ROUNDED = 1e-9  # relative difference of two formulas for one number; rounding is far below
START = 0.1  # of the step amplitude: rounded resistors move the rest of a board by less
UNSEEN = 1e-12  # V: far below the noise of any board, and above the rounding of a start at 0 V


def find_contradiction(circuit: Circuit, ideal: IdealAnswer, start: Floats) -> str:
    """Return how the board, or the `start` (N,) of its record, V, contradicts the reference.

    Where they differ they are not of the same problem, and the verdict is worth nothing. The starts
    are compared only with a reference whose error is smaller than the step.
    """
    network = ideal.network
    wanted_facts = {"lambda": network.lam, "U0": network.U0, "Ve": network.Ve}
    for name, wanted in wanted_facts.items():
        if name not in circuit.facts:
            continue  # Ve: a linear board has none
        stated = circuit.value(name)
        if not math.isclose(stated, wanted, rel_tol=ROUNDED):
            key = circuit.facts[name].key.rpartition(".")[2]
            return f"the board states {key} = {stated!r}, the reference uses {wanted!r}"
    if ideal.problem or ideal.error >= 1.0:
        return ""
    away = np.abs(start - ideal.start)
    n = int(np.argmax(away))
    if away[n] > max(START * np.abs(ideal.target - ideal.start).max(), UNSEEN):
        here, there = (show(float(u[n]), "V") for u in (start, ideal.start))
        return f"channel {n + 1} starts at {here}, in the reference at {there}"
    return ""
