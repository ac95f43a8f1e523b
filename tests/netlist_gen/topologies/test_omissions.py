"""What was left out, and why."""

from __future__ import annotations

from typing import Any

import pytest

from taction.netlist_gen.board.synthesis import synthesise
from tests.support.making import make_scene, matrix_problem

T = [[1.0, 0.0, -1.0], [2.0, 0.0, 1.0], [0.0, 0.0, 0.0]]


def omissions(**design: Any) -> dict[str, str]:
    circuit = synthesise(make_scene(design=design), matrix_problem(T, [1.0, 0.0, 2.0]))
    return {item.what: item.why for item in circuit.omissions}


def test_a_linear_board_of_ideal_opamps() -> None:
    found = omissions(opamp="ideal", stray_capacitance=0)
    assert found["10 matrix resistors"] == "5 entries of T are zero"
    assert found["1 constraint nodes"].startswith("their rows of T are all zeros")
    assert found["1 strain currents"] == "their strain is zero"
    assert found["1 inverters of u"] == "their columns have no positive entry"
    assert found["1 inverters of w"] == "their rows have no negative entry"
    assert found["stray capacitors"] == "design.stray_capacitance is 0"
    assert found["op-amp first pole"] == "ideal.gbw is inf"
    assert found["op-amp output resistance"] == "ideal.output_resistance is 0"
    assert "antilog stages and bias current" in found


@pytest.mark.parametrize(
    ("design", "inverters", "bias"),
    [({}, "2 inverters of u", False), ({"bias": False}, "2 inverters of u", True)],
)
def test_an_exponential_board(design: dict[str, Any], inverters: str, bias: bool) -> None:
    found = omissions(amplifier="exponential", **design)
    assert found[inverters] == "their columns have no negative entry"
    assert "antilog stages and bias current" not in found
    assert ("bias current" in found) is bias


def test_a_full_opamp_leaves_nothing_of_itself_out() -> None:
    assert not [what for what in omissions(opamp="tl084") if what.startswith("op-amp")]
