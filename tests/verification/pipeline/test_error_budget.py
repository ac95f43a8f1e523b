"""The error budget, part by part, on a board whose errors are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from netlist_gen.board.synthesis import synthesise
from tests.support.making import make_scene, matrix_problem
from verification.ideal.ideal_answer import ideal_answer, ideal_network
from verification.pipeline.clock import Clock
from verification.pipeline.design import design_board
from verification.pipeline.error_budget import error_budget, rounded_network


def budget(design: dict[str, Any], final: float, stress: float | None = None) -> dict[str, Any]:
    """One channel with T = 1, lam = 0.5 and eps = 3: the optimum is 2."""
    design = {"lambda": 0.5, "gain": "1Mohm", "unit_conductance": "1uS", **design}
    scene = make_scene(design={"unit_voltage": 0.5, "stray_capacitance": 0, **design})
    problem = matrix_problem([[1.0]], [3.0])
    if stress is not None:
        problem = replace(problem, stress=np.array([stress]))
    board = design_board(scene, Clock(lambda stage: None), problem=problem)
    ideal, rest = ideal_answer(board.network, scene), board.board.equilibrium
    parts = error_budget(board, ideal, rest, np.array([final]), 1e-9)
    return {part.name: part.value for part in parts}


def test_every_part_by_hand() -> None:
    ideal = {"base": "ideal", "dc_gain": 1e13}
    parts = budget({"opamp": ideal}, final=1.25, stress=3.0)
    assert parts["ill_posedness"] == pytest.approx((3.0 - 2.0) * 0.5)
    assert parts["resistors"] == pytest.approx(0.0, abs=1e-15)
    assert parts["opamps"] == pytest.approx(0.0, abs=1e-9)
    assert parts["unsettled"] == pytest.approx(0.25, rel=1e-9)
    assert parts["simulator"] == 1e-9


def test_an_unknown_truth_stays_unknown() -> None:
    assert budget({}, final=1.0)["ill_posedness"] is None


def test_a_finite_gain_is_the_opamps_part() -> None:
    """Each op-amp's gain error is about its noise gain over A0; five in the loop add up."""
    parts = budget({"opamp": {"base": "ideal", "dc_gain": 1e4}}, final=1.0)
    assert 1e-5 < parts["opamps"] < 1e-2
    ten = budget({"opamp": {"base": "ideal", "dc_gain": 1e5}}, final=1.0)
    assert parts["opamps"] / ten["opamps"] == pytest.approx(10.0, rel=0.01)


def test_rounding_is_the_resistors_part() -> None:
    """G0 = 1.05 µS asks for 952.4 kohm, E24 has 910; s = 1 and R = 1.814 Mohm become 1 and 1.8."""
    parts = budget({"unit_conductance": "1.05uS", "resistor_series": "E24"}, final=1.0)
    T, lam = 1e6 / (0.91e6 * 1.05), 1 / (1.8e6 * 1e6 * 1.05e-6**2)
    assert parts["resistors"] == pytest.approx(abs(3 * T / (T**2 + lam) - 2.0) * 0.5, rel=1e-9)


def test_the_rounded_network_has_the_boards_own_numbers() -> None:
    scene = make_scene(design={"resistor_series": "E24", "gain": 6.252e6, "resistance": 1.786e6})
    problem = matrix_problem([[1.0, -0.3]], [1.0])
    circuit = synthesise(scene, problem)
    network = ideal_network(problem, scene)
    rounded = rounded_network(network, circuit)
    assert rounded.lam == pytest.approx(1 / (6.2e6 * 1.8e6 * 3.313e-7**2), rel=1e-14)
    assert pytest.approx(1 / (np.array([[3.0e6, -10.0e6]]) * 3.313e-7)) == rounded.T
