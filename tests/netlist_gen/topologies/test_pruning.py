"""Pruned boards: which resistors are missing, and which parts go with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.topologies.frame.entries import pruned
from tests.support.making import make_scene, matrix_problem

T = [[2.0, -0.01, 0.0], [0.5, 1.0, 0.019], [0.002, 0.0, -0.015]]


def board(prune: float, **design: Any) -> Circuit:
    scene = make_scene(design={"prune": prune, "resistance": "10kohm", "gain": "1Mohm", **design})
    return synthesise(scene, matrix_problem(T, [1.0, 2.0, 3.0]))


@pytest.mark.parametrize("topology", ["integrator", "passive"])
def test_both_matrices_lose_what_is_below_the_fraction_of_the_largest(topology: str) -> None:
    """The limit of 0.005 is 0.01 of T, and -0.01 stays: it is not below."""
    circuit = board(0.005, topology=topology)
    kept = np.array(T)
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
    out, whole = np.array([0.01, 0.019, 0.002, 0.015]), np.linalg.norm(T)
    assert found["8 pruned matrix resistors"] == (
        "4 entries of T are below design.prune = 0.01 of the largest entry, the largest of them at"
        f" 0.0095; their norm is {np.linalg.norm(out) / whole:.2g} of the norm of T"
    )
    assert found["4 matrix resistors"] == "2 entries of T are zero"
    assert "2 inverters of w" in found


def test_nothing_is_pruned_without_the_key() -> None:
    matrix = np.array(T)
    assert pruned(matrix, 0.0) is matrix
    for prune in (0.0, 5e-4):
        circuit = board(prune)
        assert circuit.realised == pytest.approx(matrix, rel=1e-14)
        assert not [item for item in circuit.omissions if "pruned" in item.what]
