"""The ideal network's answer: closed forms of one channel, and what is not computed twice."""

from __future__ import annotations

from dataclasses import replace
from math import log
from multiprocessing import Pipe

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_value
from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError
from taction.verification.reference.dynamics import IdealNetwork, Response, ideal_transient
from taction.verification.reference.ideal_answer import ideal_answer, ideal_network, is_biased
from tests.support.making import make_scene, matrix_problem

ONE = IdealNetwork(T=np.array([[2.0]]), eps=np.array([3.0]), lam=1.0, RC=1e-5, U0=0.1)
SCENE = Scene.model_validate({"problem": {"kind": "tactile"}})


def test_one_channel_in_closed_form() -> None:
    answer = ideal_answer(ONE, SCENE)
    assert answer.target == pytest.approx([0.1 * 6.0 / 5.0], rel=1e-15)
    assert answer.start.tolist() == [0.0]
    assert answer.problem == ""
    assert 0.0 < answer.error < 1e-15
    assert answer.settling_time == pytest.approx(1e-5 / 5.0 * log(100.0), rel=1e-12)


def test_the_transient_of_an_exponential_network_waits_until_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One channel: C dv/dt = -v/R - q (u - w), so v'(0) and the target are known in closed form."""
    network = replace(ONE, amplifier="exponential", Ve=0.05)
    calls: list[str] = []

    def counted(*args: object, **more: object) -> Response | None:
        calls.append("transient")
        return ideal_transient(*args, **more)  # type: ignore[arg-type]

    monkeypatch.setattr("taction.verification.reference.ideal_answer.ideal_transient", counted)
    answer = ideal_answer(network, SCENE)
    x = log(answer.target[0] / 0.1)
    assert x + 2.0 * (2.0 * answer.target[0] / 0.1 - 3.0) / network.mu == pytest.approx(0, abs=1e-9)
    assert answer.start == pytest.approx([0.1], rel=1e-15)  # g(0) = 1
    assert not calls
    first = answer.settling_time
    assert answer.settling_time == first
    assert calls == ["transient"]


def test_capacitance_does_not_change_the_problem() -> None:
    first, second = ideal_answer(ONE, SCENE), ideal_answer(replace(ONE, RC=1e-3), SCENE)
    assert second.solution is first.solution
    assert second.settling_time == pytest.approx(100.0 * first.settling_time)


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


@pytest.mark.parametrize("size", [1e-30, 1e30])
def test_a_lambda_out_of_range_names_the_scene(size: float) -> None:
    scene = make_scene(design={"unit_conductance": size, "gain": size, "resistance": size})
    says = r"scene\.toml: design\.lambda = .*1.*: .* between 1e-100 and 1e\+100 for lambda"
    with pytest.raises(InputError, match=says):
        ideal_network(matrix_problem([[2.0]], [3.0]), scene)


@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
def test_goes_to_workers_with_its_figures(amplifier: str) -> None:
    network = replace(ONE, amplifier=amplifier, Ve=0.05, bias=amplifier == "exponential")
    scene = with_value(SCENE, "checks.settling_time.band", 0.02)
    answer = ideal_answer(network, scene)
    here, there = Pipe()
    with here, there:
        here.send(answer)
        sent = there.recv()
    assert sent.settling_time == answer.settling_time > 0.0
