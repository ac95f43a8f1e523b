"""Contradictions between the reference, the board and the record, beside the checked readings.

The reference takes lambda, the units and the initial state from the scene. The board states the
same numbers, and the record starts somewhere. A verdict cannot rest on numbers that differ.
"""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.quantities import show
from taction.verification.reference.ideal_answer import IdealAnswer

SAME = 1e-9  # relative difference of two formulas for one number; rounding is far below
START = 0.1  # of the step amplitude: rounded resistors move the rest of a board by less


def find_contradiction(circuit: Circuit, ideal: IdealAnswer, start: Floats) -> str:
    """Return a sentence about the first contradiction; empty if there is none.

    A step below the reference's own error, or a reference without a trusted answer, has no start
    that a record could be compared with.

    Parameters
    ----------
    circuit : Circuit
        The board with the numbers that it states.
    ideal : IdealAnswer
        The reference with its own numbers.
    start : ndarray (N,)
        Outputs at the first instant of the record, V.
    """
    network = ideal.network
    wanted_facts = {"lambda": network.lam, "U0": network.U0, "Ve": network.Ve}
    for name, wanted in wanted_facts.items():
        if name not in circuit.facts:
            continue  # Ve: a linear board has none
        stated = circuit.value(name)
        if not math.isclose(stated, wanted, rel_tol=SAME):
            key = circuit.facts[name].key.rpartition(".")[2]
            return f"the board states {key} = {stated!r}, the reference uses {wanted!r}"
    if ideal.problem or ideal.error >= 1.0:
        return ""
    away = np.abs(start - ideal.start)
    n = int(np.argmax(away))
    if away[n] > START * np.abs(ideal.target - ideal.start).max():
        here, there = (show(float(u[n]), "V") for u in (start, ideal.start))
        return f"channel {n + 1} starts at {here}, in the reference at {there}"
    return ""
