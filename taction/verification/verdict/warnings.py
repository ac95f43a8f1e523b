"""Warnings, which make no check fail, and what else limits what a verdict can say of a board.

The reference takes lambda, the units and the initial state from the scene; the board states them,
too, and the record has a first point. Where they differ, all three are not of the same problem, and
the verdict is worth nothing. An imported op-amp may lack one of the witnesses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.part_warnings import part_warnings, stuck_cells
from taction.netlist_gen.scene.slips import questions
from taction.spice_models.imported import ImportedOpAmp
from taction.spice_models.input_errors import not_known
from taction.system.array_types import Floats
from taction.system.quantities import show
from taction.system.reading_definitions import EXCURSIONS, READINGS
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.checks import Evidence

WELL_ABOVE = 10.0  # a tolerance should be this many times the error of the simulation


def all_warnings(evidence: Evidence) -> tuple[str, ...]:
    """Return the warnings of the scene, the parts, the plan, the engine and the readings."""
    run = evidence.run
    if run is None:
        return find_warnings(evidence)
    board = run.board
    remarks = (
        *questions(board.scene),
        *run.ends.flags,
        *board.plan.notes,
        *part_warnings(board.circuit, board.rest),
        *stuck_cells(board.circuit),
        *notes(board.circuit),
        *not_known(board.circuit.models.values()),
    )
    return find_warnings(evidence, remarks)


def find_warnings(evidence: Evidence, notes: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return warnings: tolerances too close to the simulation's error, fragile readings.

    `notes` are the remarks of the engine and of the plan; they come first.
    """
    if not evidence.poles.known_stable:
        return notes  # the stability check does not pass, so close tolerances no longer matter
    warnings = list(notes)
    checks, error = evidence.limits, evidence.error
    remedy = "set a smaller analysis.error or a larger analysis.points_per_period"
    if checks.steady_state.tolerance < WELL_ABOVE * error.steady_state:
        warnings.append(
            f"steady_state: the tolerance {checks.steady_state.tolerance:g} is not well above the"
            f" error {error.steady_state:.2g} of the simulation; {remedy}"
        )
    for name in EXCURSIONS:
        check, off = getattr(checks, name), error.readings[name]
        if check is not None and check.max < WELL_ABOVE * off:
            warnings.append(
                f"{name}: the limit {check.max:g} is not well above the error {off:.2g} of the"
                f" simulation; {remedy}"
            )
    if evidence.poles.damping_ratio < 1e-3:
        warnings.append(
            f"damping ratio {evidence.poles.damping_ratio:.2g}: the board nearly oscillates;"
            " component tolerances can make it oscillate"
        )
    for channel in evidence.measurements.channels:
        for name, reading in channel.fragile.items():
            if reading.alternative is not None:
                kind, what = READINGS[name], name.replace("_", " ")
                warnings.append(
                    f"channel {channel.index + 1}: {what} {show(reading.value, kind.unit)} is"
                    f" fragile: {show(reading.alternative, kind.unit)} with {kind.shifted}"
                )
    return tuple(warnings)


def missing_witness(circuit: Circuit, engine: str) -> str:
    """Return which of the two witnesses a board with imported op-amps lacks; empty for none.

    Without a linear model the state-space engine has the two poles of the measured figures, which
    is an estimate and confirms nothing. Without ngspice nothing has the limits of the netlist.
    """
    for name, imported in _imported(circuit):
        if imported.linear is None:
            return f"op-amp {name} has no state-space witness: {imported.missing}"
        if engine != "ngspice":
            return f"the slew rate and limits of op-amp {name} are in its netlist: run ngspice"
    return ""


def notes(circuit: Circuit) -> tuple[str, ...]:
    """Return one remark about the linear model of each imported op-amp."""
    return tuple(
        f"op-amp {name} is imported: the state-space engine has its cards, linear about"
        f" their rest, within {100.0 * imported.linear.error:.2g} % of ngspice's small signal up to"
        f" {show(imported.linear.band[1], 'Hz', 3)}"
        for name, imported in _imported(circuit)
        if imported.linear is not None
    )


def _imported(circuit: Circuit) -> Iterator[tuple[str, ImportedOpAmp]]:
    for name, model in circuit.models.items():
        if model.imported is not None:
            yield name, model.imported


ROUNDED = 1e-9  # relative difference of two formulas for one number; rounding is far below
START = 0.1  # of the step amplitude: rounded resistors move the rest of a board by less
UNSEEN = 1e-12  # V: far below the noise of any board, and above the rounding of a start at 0 V


def find_contradiction(circuit: Circuit, ideal: IdealAnswer, start: Floats) -> str:
    """Return a sentence about the first contradiction; empty if there is none.

    The starts are compared only if the reference can be trusted, and if its error is smaller than
    the step.

    `circuit`: the board with the numbers that it states.
    `ideal`: the reference with its own numbers.
    `start` (N,): outputs at the first instant of the record, V.
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
