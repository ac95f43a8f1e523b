"""Ideal transients against closed forms, the matrix exponential and quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm

from taction.verification.reference.dynamics import (
    IdealNetwork,
    Response,
    ScaledNetwork,
    ideal_linear,
    ideal_transient,
)
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from tests.support.oracle import kernel
from tests.support.readings import Samples, rise_time

Y = np.linspace(-3.0, 3.0, 7)
MATRIX = kernel(Y, Y, 1.0)
STRAIN = MATRIX @ np.maximum(1.0 - Y * Y, 0.0) + 0.02 * np.cos(5.0 * Y)
R, C, S, G0, U0 = 2e6, 1e-11, 3e6, 1e-6, 0.5  # the components of the network below
BOARD = IdealNetwork(MATRIX, STRAIN, lam=1.0 / (R * S * G0**2), RC=R * C, U0=U0)
REST = np.zeros(7)


def test_one_channel_is_an_rc_step() -> None:
    network = IdealNetwork(np.eye(1), np.ones(1), lam=0.25, RC=1e-6, U0=2.0)
    assert network.mu == 0.25
    tau = 1e-6 / (1.0 + 4.0)
    response = ideal_linear(network, np.zeros(1))
    assert response.target == pytest.approx([2.0 / 1.25], rel=1e-15)
    assert response.settling_time(0.01) == pytest.approx(tau * np.log(100.0), rel=1e-12)
    assert response.rise_time(0) == pytest.approx(tau * np.log(9.0), rel=1e-12)
    t = np.array([0.0, 0.3e-6])
    assert response.outputs(t)[:, 0] == pytest.approx(1.6 * (1.0 - np.exp(-t / tau)), rel=1e-12)


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
    rises = [[each.rise_time(n) for n in range(7)] for each in (run, exact)]
    assert np.isfinite(rises[0]).any()
    assert rises[0] == pytest.approx(rises[1], rel=1e-6, nan_ok=True)


def test_one_exponential_channel_by_quadrature() -> None:
    network = IdealNetwork(np.eye(1), np.ones(1), 2e-3, 1e-6, 1.0, "exponential", 0.1)
    start = np.array([-0.5])
    run = ideal_transient(network, start)
    assert run is not None
    mu, begin = network.mu, -0.5 / 0.1
    level = float(np.log(0.5 * (np.exp(begin) + network.rest.u[0])))
    # Time is the integral of dx / (dx/dt), t in units of R C.
    wanted, _ = quad(lambda x: 1.0 / (-x - (np.exp(x) - 1.0) / mu), begin, level, epsrel=1e-12)
    reached = run.outputs(np.array([wanted * 1e-6]))[0, 0]
    assert reached == pytest.approx(np.exp(level), rel=1e-8)


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


def test_a_record_that_is_too_short_never_settles() -> None:
    run = ideal_transient(BOARD, REST, stop=1e-7)
    assert run is not None
    assert run.settling_time() == float("inf")
    assert np.isnan(run.rise_time(3))


def test_overflow_is_an_outcome() -> None:
    run = ideal_transient(replace(BOARD, amplifier="exponential", Ve=1e-3), np.full(7, 5.0))
    assert run is None


def test_nothing_moves_without_strain() -> None:
    response = ideal_linear(replace(BOARD, eps=np.zeros(7)), REST)
    assert response.settling_time() == 0.0
    assert np.isnan(response.rise_time(3))


def test_modes_refuse_other_amplifiers() -> None:
    with pytest.raises(ValueError, match="not exponential"):
        ideal_linear(replace(BOARD, amplifier="exponential"), REST)


def test_settling_is_the_last_crossing_and_rise_the_first() -> None:
    def outputs(t: np.ndarray) -> np.ndarray:
        ringing = 1.0 - np.exp(-t) * np.cos(5.0 * t)
        return np.stack([ringing, 0.01 * ringing], axis=1)

    response = Response(np.linspace(0.0, 20.0, 4001), outputs, np.zeros(2), np.array([1.0, 0.01]))
    settled = response.settling_time(0.05)
    assert outputs(np.array([settled]))[0, 0] == pytest.approx(
        1.05 if outputs(np.array([settled]))[0, 0] > 1 else 0.95, abs=1e-9
    )
    after = outputs(np.linspace(settled * (1 + 1e-9), 20.0, 10_000))[:, 0]
    assert np.all(np.abs(after - 1.0) <= 0.05 + 1e-9)
    assert np.isnan(response.rise_time(1))  # 1 % of the amplitude
    ringing = Samples.of_function(
        lambda t: float(outputs(np.array([t]))[0, 0]) - 1.0, np.linspace(0.0, 20.0, 2001), 0.0
    )
    assert settled == pytest.approx(ringing.last_outside(0.05), rel=1e-8)
    assert response.rise_time(0) == pytest.approx(rise_time(ringing, 1.0), rel=1e-6)
