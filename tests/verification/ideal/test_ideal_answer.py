"""The ideal network's answer: closed forms of one channel, and what is not computed twice."""

from __future__ import annotations

from dataclasses import replace
from math import log
from multiprocessing import Pipe

import numpy as np
import pytest

from netlist_gen.overrides.axes import with_value
from netlist_gen.scene.scene import Scene
from verification.ideal.ideal_answer import ideal_answer
from verification.reference import IdealNetwork

ONE = IdealNetwork(
    T=np.array([[2.0]]), eps=np.array([3.0]), G0=1e-6, U0=0.1, R=1e6, C=1e-11, s=1e6
)  # mu = 1
SCENE = Scene.model_validate({"problem": {"kind": "tactile"}})


def test_one_channel_in_closed_form() -> None:
    answer = ideal_answer(ONE, SCENE)
    assert answer.target == pytest.approx([0.1 * 6.0 / 5.0], rel=1e-15)
    assert answer.start.tolist() == [0.0]
    assert answer.problem == ""
    assert 0.0 < answer.error < 1e-15
    assert answer.transient.settling_time == pytest.approx(1e-5 / 5.0 * log(100.0), rel=1e-12)
    assert answer.transient.energy_residual < 1e-12


def test_capacitance_does_not_change_the_problem() -> None:
    first, second = ideal_answer(ONE, SCENE), ideal_answer(replace(ONE, C=1e-9), SCENE)
    assert second.solution is first.solution
    assert second.transient.settling_time == pytest.approx(100.0 * first.transient.settling_time)


@pytest.mark.parametrize(
    "other",
    [
        replace(ONE, R=2e6),
        replace(ONE, eps=np.array([4.0])),
        replace(ONE, T=np.array([[-2.0]])),
        replace(ONE, T=np.array([[2.0, 0.0]])),
    ],
)
def test_another_problem_is_solved(other: IdealNetwork) -> None:
    T, lam = other.T, other.mu
    wanted = np.linalg.solve(T.T @ T + lam * np.eye(T.shape[1]), T.T @ other.eps)
    ideal_answer(ONE, SCENE)
    assert ideal_answer(other, SCENE).solution.u == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
def test_goes_to_workers_with_its_figures(amplifier: str) -> None:
    network = replace(ONE, amplifier=amplifier, Ve=0.05, bias=amplifier == "exponential")
    scene = with_value(SCENE, "checks.settling_time.band", 0.02)
    answer = ideal_answer(network, scene)
    here, there = Pipe()
    with here, there:
        here.send(answer)
        sent = there.recv()
    assert sent.transient.settling_time == answer.transient.settling_time > 0.0
    assert sent.transient.energy_residual == answer.transient.energy_residual < 1e-9
