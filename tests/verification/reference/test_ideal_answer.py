"""Ideal answers against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.netlist_gen.scene.scene import Scene
from taction.verification.reference.ideal_answer import (
    IdealNetwork,
    ideal_answer,
    ideal_network,
    is_biased,
)
from tests.support.making import make_scene, matrix_problem

ONE = IdealNetwork(T=np.array([[2.0]]), eps=np.array([3.0]), lam=1.0, RC=1e-5, U0=0.1)
SCENE = Scene.model_validate({"problem": {"kind": "tactile"}})


def test_one_channel_in_closed_form() -> None:
    answer = ideal_answer(ONE, SCENE)
    assert answer.target == pytest.approx([0.1 * 6.0 / 5.0], rel=1e-15)
    assert answer.start.tolist() == [0.0]
    assert answer.problem == ""
    assert 0.0 < answer.error < 1e-15


@pytest.mark.parametrize(
    "other",
    [
        replace(ONE, lam=0.5),
        replace(ONE, eps=np.array([4.0])),
        replace(ONE, T=np.array([[-2.0]])),
        replace(ONE, T=np.array([[2.0, 0.0]])),
    ],
)
def test_another_problem_is_solved(other: IdealNetwork) -> None:
    T, lam = other.T, other.lam
    wanted = np.linalg.solve(T.T @ T + lam * np.eye(T.shape[1]), T.T @ other.eps)
    ideal_answer(ONE, SCENE)
    assert ideal_answer(other, SCENE).solution.u == pytest.approx(wanted, rel=1e-14)


def test_lambda_is_the_number_of_the_scene() -> None:
    """No component enters: a board of other components has the same problem."""
    problem = matrix_problem([[2.0]], [3.0])
    for design in ({}, {"gain": "1Mohm"}, {"unit_conductance": "1uS"}, {"unit_voltage": "2V"}):
        network = ideal_network(problem, make_scene(design={"lambda": 0.1, **design}))
        assert network.problem.lam == 0.1


@pytest.mark.parametrize(("amplifier", "lam"), [("linear", 0.25), ("exponential", 0.1)])
def test_a_given_resistance_has_its_lambda(amplifier: str, lam: float) -> None:
    """``1 / (R s G0²)`` and ``2 Ve / (R s G0² U0)``, and R C for the time."""
    design = {"amplifier": amplifier, "resistance": 1e6, "gain": 4e6, "unit_conductance": 1e-6}
    if amplifier == "exponential":
        design |= {"exponential_slope": 0.1, "unit_voltage": 0.5}
    problem = matrix_problem([[2.0]], [3.0])
    given = ideal_network(problem, make_scene(design=design))
    assert given.lam == pytest.approx(lam, rel=1e-15)
    assert pytest.approx(1e6 * 1e-11, rel=1e-15) == given.RC
    del design["resistance"]
    asked = ideal_network(problem, make_scene(design={**design, "lambda": lam}))
    assert pytest.approx(given.RC, rel=1e-15) == asked.RC


@pytest.mark.parametrize("amplifier", AMPLIFIERS)
def test_board_and_reference_agree_about_the_bias(amplifier: str) -> None:
    """Each has a table of its own for the default."""
    for bias in (None,) if amplifier == "linear" else (None, False, True):
        scene = make_scene(design={"amplifier": amplifier, "bias": bias})
        assert is_biased(scene) is scene.design.biased
