"""Energy along a board's trajectory, against trajectories whose energy is known."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.reference.dynamics import IdealNetwork, ideal_linear
from taction.verification.reference.ideal_answer import energy_rise

SCALE = {"lam": 1.0, "RC": 1e-5, "U0": 2.0}
NETWORK = IdealNetwork(T=np.array([[1.0, 0.3], [-0.2, 0.8]]), eps=np.array([0.6, 0.4]), **SCALE)


def test_an_ideal_trajectory_never_rises():
    response = ideal_linear(NETWORK, np.zeros(2))
    found = energy_rise(NETWORK, response.time, response.outputs(response.time))
    assert found.rise <= 1e-12


def test_an_overshoot_rises_by_the_quadratic_form():
    """Beyond the rest state by d, the energy is above its least by ½ d'(T'T/mu + I) d."""
    rest = ideal_linear(NETWORK, np.zeros(2)).target
    d = 0.25 * rest
    u = np.array([np.zeros(2), rest, rest + d, rest])
    found = energy_rise(NETWORK, np.array([0.0, 1.0, 2.0, 3.0]), u)
    hessian = NETWORK.T.T @ NETWORK.T / NETWORK.mu + np.eye(2)
    expected = (d @ hessian @ d) / (rest @ hessian @ rest)
    assert found.rise == pytest.approx(expected, rel=1e-9)
    assert found.time == 2.0


def test_outputs_outside_the_amplifiers_range_have_no_energy():
    positive = IdealNetwork(NETWORK.T, NETWORK.eps, **SCALE, amplifier="exponential")
    assert energy_rise(positive, np.array([0.0, 1.0]), np.array([[1.0, 1.0], [0.5, -0.1]])) is None


def test_an_energy_that_never_falls_has_no_rise():
    response = ideal_linear(NETWORK, np.zeros(2))
    u = np.array([response.target, response.target + 0.1])
    assert energy_rise(NETWORK, np.array([0.0, 1.0]), u) is None
