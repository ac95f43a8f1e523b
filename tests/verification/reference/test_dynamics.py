"""Ideal transients and answers against closed forms, the matrix exponential and quadrature."""

from __future__ import annotations

from dataclasses import replace
from math import log

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.netlist_gen.scene.scene import Scene
from taction.verification.reference.ideal_answer import (
    IdealNetwork,
    Response,
    ScaledNetwork,
    ideal_answer,
    ideal_linear,
    ideal_network,
    ideal_transient,
    is_biased,
)
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from tests.support.making import make_scene, matrix_problem
from tests.support.oracle import kernel
from tests.support.readings import Samples

Y = np.linspace(-3.0, 3.0, 7)
MATRIX = kernel(Y, Y, 1.0)
STRAIN = MATRIX @ np.maximum(1.0 - Y * Y, 0.0) + 0.02 * np.cos(5.0 * Y)
R, C, S, G0, U0 = 2e6, 1e-11, 3e6, 1e-6, 0.5  # the components of the network below
BOARD = IdealNetwork(MATRIX, STRAIN, lam=1.0 / (R * S * G0**2), RC=R * C, U0=U0)
REST = np.zeros(7)


@pytest.mark.parametrize("shape", [(3, 5), (5, 3), (4, 4)])
def test_modes_are_the_matrix_exponential(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    T, eps, v0 = rng.standard_normal(shape), rng.standard_normal(shape[0]), rng.random(shape[1])
    network = replace(BOARD, T=T, eps=eps)
    A = -(np.eye(shape[1]) / R + S * G0**2 * T.T @ T) / C
    load = S * G0**2 * U0 * T.T @ eps / C
    rest = -np.linalg.solve(A, load)
    response = ideal_linear(network, v0)
    assert response.target == pytest.approx(rest, rel=1e-12)
    for t in (0.0, 3e-7, 2e-5):
        wanted = rest + expm(A * t) @ (v0 - rest)
        assert response.outputs(np.array([t]))[0] == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def test_radau_agrees_with_the_modes() -> None:
    exact, run = ideal_linear(BOARD, REST), ideal_transient(BOARD, REST)
    assert run is not None
    t = run.time[::50]
    assert run.outputs(t) == pytest.approx(exact.outputs(t), abs=1e-8)
    assert run.settling_time() == pytest.approx(exact.settling_time(), rel=1e-6)


@pytest.mark.parametrize("amplifier", ["exponential", "sinh", "softplus", "tanh"])
@pytest.mark.parametrize("lam", [0.27, 5e-5])
def test_other_amplifiers_against_lsoda(amplifier: str, lam: float) -> None:
    network = replace(BOARD, amplifier=amplifier, lam=lam, Ve=0.2)
    run, scaled = ideal_transient(network, REST), ScaledNetwork(network)
    assert run is not None
    assert run.outputs(run.time[-1:])[0] == pytest.approx(run.target, abs=1e-6 * run.amplitude)
    wanted = solve(Problem(MATRIX, STRAIN, lam, amplifier))
    assert run.target == pytest.approx(network.U0 * wanted.u, rel=1e-13)
    times = run.time[:: len(run.time) // 20]
    other = solve_ivp(
        scaled.slope, (0.0, times[-1] / network.RC), REST, "LSODA", times / network.RC,
        jac=scaled.jacobian, rtol=1e-10, atol=1e-10,
    )  # fmt: skip
    found = network.U0 * scaled.g.g(other.y.T)
    assert run.outputs(times) == pytest.approx(found, abs=1e-7 * run.amplitude)


def test_stiffness_does_not_depend_on_the_capacitor() -> None:
    network = replace(BOARD, amplifier="exponential", Ve=0.2, bias=True)
    rest = network.rest
    D = np.sqrt(rest.u)
    sigma = np.linalg.svd(MATRIX * D, compute_uv=False)
    wanted = (network.mu + sigma[0] ** 2) / (network.mu + sigma[-1] ** 2)
    for each in (network, replace(network, RC=1.0)):
        assert ScaledNetwork(each).stiffness(rest.v) == pytest.approx(wanted, rel=1e-12)


def test_what_never_settles_overflows_or_never_moves_is_an_outcome() -> None:
    short = ideal_transient(BOARD, REST, stop=1e-7)
    assert short is not None
    assert short.settling_time() == float("inf")
    steep = replace(BOARD, amplifier="exponential", Ve=1e-3)
    assert ideal_transient(steep, np.full(7, 5.0)) is None
    assert ideal_linear(replace(BOARD, eps=np.zeros(7)), REST).settling_time() == 0.0


def test_settling_is_the_last_crossing() -> None:
    def outputs(t: np.ndarray) -> np.ndarray:
        return (1.0 - np.exp(-t) * np.cos(5.0 * t))[:, None]

    response = Response(np.linspace(0.0, 20.0, 4001), outputs, np.zeros(1), np.ones(1))
    ringing = Samples.of_function(
        lambda t: float(outputs(np.array([t]))[0, 0]) - 1.0, np.linspace(0.0, 20.0, 2001), 0.0
    )
    assert response.settling_time(0.05) == pytest.approx(ringing.last_outside(0.05), rel=1e-8)


@pytest.mark.parametrize("turn", [-1e-15, 1e-15])
def test_a_value_at_the_band_that_rounds_to_either_side_settles_there(turn: float) -> None:
    """``1 - exp(-t)`` is at the band of 1/e at t = 1, on another side in each evaluation."""
    time = np.linspace(0.0, 8.0, 9)

    def outputs(t: np.ndarray) -> np.ndarray:
        off = turn if len(t) == len(time) else -turn
        return (1.0 - np.exp(-t) * (1.0 + off))[:, None]

    response = Response(time, outputs, np.zeros(1), np.ones(1))
    assert response.settling_time(np.exp(-1.0)) == pytest.approx(1.0, abs=1e-12)


ONE = IdealNetwork(T=np.array([[2.0]]), eps=np.array([3.0]), lam=1.0, RC=1e-5, U0=0.1)
SCENE = Scene.model_validate({"problem": {"kind": "tactile"}})


def test_one_channel_in_closed_form() -> None:
    answer = ideal_answer(ONE, SCENE)
    assert answer.target == pytest.approx([0.1 * 6.0 / 5.0], rel=1e-15)
    assert answer.start.tolist() == [0.0]
    assert answer.problem == ""
    assert 0.0 < answer.error < 1e-15
    assert answer.settling_time == pytest.approx(1e-5 / 5.0 * log(100.0), rel=1e-12)


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
