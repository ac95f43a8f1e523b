"""Trajectories of ideal networks against the matrix exponential, LSODA and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from taction.system.errors import SolverError
from taction.verification.evidence.paper.ideal_flow import (
    ScaledNetwork,
    energy_rise,
    ideal_record,
    linear_outputs,
    settling_time,
)
from taction.verification.reference.ideal_answer import IdealAnswer, IdealNetwork
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from tests.support.oracle import kernel

Y = np.linspace(-3.0, 3.0, 7)
MATRIX = kernel(Y, Y, 1.0)
STRAIN = MATRIX @ np.maximum(1.0 - Y * Y, 0.0) + 0.02 * np.cos(5.0 * Y)
R, C, S, G0, U0 = 2e6, 1e-11, 3e6, 1e-6, 0.5  # the components of the network below
BOARD = IdealNetwork(MATRIX, STRAIN, lam=1.0 / (R * S * G0**2), RC=R * C, U0=U0)
REST = np.zeros(7)


@pytest.mark.parametrize("shape", [(3, 5), (5, 3), (4, 4)])
def test_modes_are_the_matrix_exponential(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    T, eps = rng.standard_normal(shape), rng.standard_normal(shape[0])
    A = -(np.eye(shape[1]) / R + S * G0**2 * T.T @ T) / C
    rest = -np.linalg.solve(A, S * G0**2 * U0 * T.T @ eps / C)
    time, u = linear_outputs(replace(BOARD, T=T, eps=eps))
    assert u[-1] == pytest.approx(rest, rel=1e-12)
    for k in (0, 1000, 2500):
        wanted = rest - expm(A * time[k]) @ rest
        assert u[k] == pytest.approx(wanted, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("amplifier", ["exponential", "sinh", "softplus", "tanh"])
@pytest.mark.parametrize("lam", [0.27, 5e-5])
def test_other_amplifiers_against_lsoda(amplifier: str, lam: float) -> None:
    network = replace(BOARD, amplifier=amplifier, lam=lam, Ve=0.2)
    scaled, wanted = ScaledNetwork(network), solve(Problem(MATRIX, STRAIN, lam, amplifier))
    run = scaled.trajectory(REST)
    assert scaled.g.g(run(run.t_max)) == pytest.approx(wanted.u, abs=1e-6 * np.abs(wanted.u).max())
    times = np.linspace(0.0, run.t_max, 20)
    other = solve_ivp(
        scaled.slope, (0.0, times[-1]), REST, "LSODA", times,
        jac=scaled.jacobian, rtol=1e-10, atol=1e-10,
    )  # fmt: skip
    found, size = scaled.g.g(other.y), np.abs(wanted.u).max()
    assert scaled.g.g(run(times)) == pytest.approx(found, abs=1e-7 * size)


@pytest.mark.parametrize(("amplifier", "lam"), [("linear", 0.1), ("rectifier", 0.2)])
def test_one_channel_settles_as_the_closed_form(amplifier: str, lam: float) -> None:
    """A rectifier is linear above zero; the energy is a parabola around the rest."""
    network = IdealNetwork(np.ones((1, 1)), np.ones(1), lam, 1e-6, 2.0, amplifier, Ve=0.2)
    answer = IdealAnswer(network, network.rest, np.zeros(1), 2.0 * network.rest.u, 0.0, "")
    time, u = ideal_record(answer)
    assert u[-1, 0] == pytest.approx(2.0 / 1.1, rel=1e-7)
    assert settling_time(time, u, 0.01) == pytest.approx(1e-6 * np.log(100.0) / 11.0, rel=1e-4)
    assert energy_rise(network, time, u)[0] < 1e-9
    beyond = u[-1, 0] * np.array([[0.0], [1.0], [1.5], [1.0]])  # a quarter of the fall, at 2 s
    assert energy_rise(network, np.arange(4.0), beyond) == pytest.approx((0.25, 2.0), rel=1e-6)
    assert energy_rise(network, np.arange(2.0), 0.0 * beyond[:2]) is None


def test_stiffness_does_not_depend_on_the_capacitor() -> None:
    network = replace(BOARD, amplifier="exponential", Ve=0.2, bias=True)
    rest = network.rest
    D = np.sqrt(rest.u)
    sigma = np.linalg.svd(MATRIX * D, compute_uv=False)
    wanted = (network.mu + sigma[0] ** 2) / (network.mu + sigma[-1] ** 2)
    for each in (network, replace(network, RC=1.0)):
        assert ScaledNetwork(each).stiffness(rest.v) == pytest.approx(wanted, rel=1e-12)


def test_what_overflows_is_refused() -> None:
    steep = replace(BOARD, amplifier="exponential", Ve=1e-3)
    with pytest.raises(SolverError, match="too stiff"):
        ScaledNetwork(steep).trajectory(np.full(7, 5e3))


def test_settling_is_the_last_crossing() -> None:
    time = np.linspace(0.0, 40.0, 4001)
    u = (1.0 - np.exp(-time))[:, None]
    assert settling_time(time, u, 0.01) == pytest.approx(np.log(100.0), rel=1e-4)
    assert settling_time(time, np.zeros((4001, 1))) == 0.0
