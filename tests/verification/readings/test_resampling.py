"""Resampling against polynomials, for which it is exact, and sinusoids, for the order."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.readings.signals import lagrange, resample, typical_step


def simulator_times(points=200, step=1e-6):
    """Small steps at the beginning, even ones after, and two that are cut to meet the end."""
    head = np.concatenate([[0.0], np.cumsum(step * 1.3 ** np.arange(-20.0, 0.0))])
    tail = head[-1] + step * np.arange(1, points)
    return np.concatenate([head, tail, tail[-1] + step * np.array([0.4, 0.8])])


@pytest.mark.parametrize("points", [2, 4, 6])
def test_polynomials_of_the_stencils_degree_are_exact(rng, points):
    time = np.cumsum(rng.uniform(0.5, 1.5, 40)) / 40
    powers = np.arange(points)
    at = np.concatenate([rng.uniform(time[0], time[-1], 100), time[[0, 7, -1]]])
    found = lagrange(time, time[:, None] ** powers, at, points)
    np.testing.assert_allclose(found, at[:, None] ** powers, atol=1e-12)


def test_six_points_are_sixth_order():
    errors = []
    for n in (101, 201):
        time = np.linspace(0, 1, n)
        at = np.linspace(0.1, 0.9, 977)
        errors.append(
            np.abs(lagrange(time, np.sin(9 * time)[:, None], at, 6)[:, 0] - np.sin(9 * at))
        )
    assert errors[0].max() / errors[1].max() == pytest.approx(64, rel=0.1)


def test_the_usual_step():
    assert typical_step(simulator_times()) == pytest.approx(1e-6, rel=1e-12)
    even = np.linspace(0, 3, 1001)
    assert typical_step(even) == 3 / 1000
    uneven = np.cumsum(np.arange(1.0, 12.0))
    assert typical_step(uneven) == min(np.median(np.diff(uneven)), np.diff(uneven).mean())


def test_points_that_are_met_are_taken_as_they_are(rng):
    time = simulator_times()
    noise = rng.standard_normal((time.size, 3))  # nothing between the points would be exact
    at, found = resample(time, noise, 3e-6, typical_step(time), time.size - 3, 50, 6)
    picked = np.arange(time.size - 3 - 3 * 49, time.size - 2, 3)
    assert at.size == 50
    np.testing.assert_allclose(at, time[picked], rtol=1e-12)
    np.testing.assert_array_equal(found, noise[picked])


def test_the_rest_is_interpolated():
    time = simulator_times()
    usual = typical_step(time)
    at, found = resample(time, np.sin(3e5 * time)[:, None], usual / 2, usual, 60, 10_000, 6)
    assert at[0] >= time[0]
    assert at[0] - time[0] < usual / 2
    assert time[-1] - at[-1] < usual / 2
    assert np.abs(at - time[60]).min() == 0
    np.testing.assert_allclose(found[:, 0], np.sin(3e5 * at), atol=1e-5)
