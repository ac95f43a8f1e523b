"""What was left out, and why: parts that the scene does not need, and pruned entries."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
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


PRUNED = [[2.0, -0.01, 0.0], [0.5, 1.0, 0.019], [0.002, 0.0, -0.015]]


def board(prune: float, **design: Any) -> Circuit:
    scene = make_scene(design={"prune": prune, "resistance": "10kohm", "gain": "1Mohm", **design})
    return synthesise(scene, matrix_problem(PRUNED, [1.0, 2.0, 3.0]))


@pytest.mark.parametrize("topology", ["integrator", "passive"])
def test_both_matrices_lose_what_is_below_the_fraction_of_the_largest(topology: str) -> None:
    """The limit of 0.005 is 0.01 of T, and -0.01 stays: it is not below."""
    circuit = board(0.005, topology=topology)
    kept = np.array(PRUNED)
    kept[2, 0] = 0.0
    assert circuit.realised == pytest.approx(kept, rel=1e-14)
    for matrix in circuit.matrices:
        assert np.array_equal(np.isfinite(matrix.ohms), kept != 0.0)


def test_a_row_without_entries_has_no_op_amps_and_no_strain() -> None:
    circuit = board(0.01)
    cells = {cell.name for cell in circuit.opamps}
    assert {"c_1", "c_2"} <= cells
    assert not {"c_3", "z_1", "z_2", "z_3"} & cells  # no negative entry is left
    assert {part.name for part in circuit.currents} == {"eps_1", "eps_2"}


def test_the_omission_has_the_numbers() -> None:
    """Left out are 0.01, 0.019, 0.002 and 0.015 of T: 0.0095 of the largest entry at most."""
    found = {item.what: item.why for item in board(0.01).omissions}
    out, whole = np.array([0.01, 0.019, 0.002, 0.015]), np.linalg.norm(PRUNED)
    assert found["8 pruned matrix resistors"] == (
        "4 entries of T are below design.prune = 0.01 of the largest entry, the largest of them at"
        f" 0.0095; their norm is {np.linalg.norm(out) / whole:.2g} of the norm of T"
    )
    assert found["4 matrix resistors"] == "2 entries of T are zero"
    assert "2 inverters of w" in found
