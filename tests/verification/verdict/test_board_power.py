"""Supply current and dissipation, by hand and by the balance of a whole board."""

from __future__ import annotations

from collections import defaultdict

import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.verdict.board_power import board_power
from tests.support.making import NEAR_IDEAL, make_scene, matrix_problem


def test_one_channel_by_hand() -> None:
    """The output is 1 V at v_1, -1 V at a_1 and -0.5 V at w_1: eps = 3, T = 1, lambda = 0.5.

    v_1 drives R = 2 Mohm and an inverter, a_1 is loaded by the inverter and T, w_1 by s and T.
    """
    design = {"lambda": 0.5, "gain": "1Mohm", "unit_conductance": "1uS", "unit_voltage": 0.5}
    opamp = NEAR_IDEAL | {"supply_current": "1mA"}
    scene = make_scene(design=design | {"supply": "±10V", "opamp": opamp})
    power = board_power(LinearBoard(synthesise(scene, matrix_problem([[1.0]], [3.0]))))
    v, a, w = 100.5e-6, 101e-6, 1e-6
    assert power.quiescent == pytest.approx(3 * 20 * 1e-3)
    assert power.outputs == pytest.approx(9.0 * v + 9.0 * a + 9.5 * w, rel=1e-9)
    assert power.resistors == pytest.approx(0.5e-6 + 200e-6 + 1e-6 + 0.5e-6, rel=1e-9)
    assert power.supply_current == pytest.approx(3e-3 + a + w, rel=1e-9)


@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
def test_what_the_supplies_deliver_is_dissipated(amplifier: str) -> None:
    """Tellegen: the op-amps, amplifiers and sources deliver what the resistors take."""
    scene = make_scene(design={"amplifier": amplifier, "opamp": NEAR_IDEAL, "lambda": 0.4})
    problem = matrix_problem([[0.3, -0.2, 0.5], [0.1, 0.4, 0.25]], [1.0, -0.5])
    board = LinearBoard(synthesise(scene, problem))
    circuit, rest, currents = board.circuit, board.equilibrium, defaultdict[str, float](float)
    placed = [(part.a, part.b, part.ohms) for part in circuit.resistors]
    placed += [element[2:] for matrix in circuit.matrices for element in matrix.elements()]
    for a, b, ohms in placed:
        currents[a] += (rest[a] - rest[b]) / ohms
        currents[b] -= (rest[a] - rest[b]) / ohms
    delivered = sum(rest[node] * amps for node, amps in currents.items())
    assert board_power(board).resistors == pytest.approx(delivered, rel=1e-9)
