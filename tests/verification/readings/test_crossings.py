"""Crossings and peaks between points, against closed forms."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from taction.verification.readings.crossings import (
    Crossing,
    first_crossings,
    highest,
    interpolate,
    last_crossings,
)


def last_above(time, y, level):
    """The last crossing of one waveform and one level, or None."""
    found = last_crossings(time, y[None], np.array([[level]]))
    at, doubt = found.time.item(), found.uncertainty.item()
    return None if np.isnan(at) else Crossing(at, doubt)


def test_a_cubic_is_interpolated_exactly_on_uneven_points(rng):
    time = np.sort(rng.uniform(0, 1, 12))
    at = np.linspace(time[0], time[-1], 40)

    def cubic(t):
        return 2 - t + 3 * t**2 - 5 * t**3

    interval = np.minimum(np.searchsorted(time, at, side="right") - 1, 10)
    row = np.zeros(40, dtype=int)
    value, doubt = interpolate(time, cubic(time)[None], row, interval, at[:, None])
    np.testing.assert_allclose(value[:, 0], cubic(at), atol=1e-12)
    assert (doubt >= 0).all()


def test_never_above_and_still_above():
    time = np.linspace(0, 1, 11)
    assert last_above(time, time, 2.0) is None
    assert last_above(time, time, 0.5) == (1.0, 0.0)


def test_many_rows_and_levels_at_once_are_exponentials_crossings(rng):
    """A row, a time constant: ``tau ln(1/level)`` each way, and each level on its own row."""
    time = np.sort(np.concatenate([[0.0, 9.0], rng.uniform(0, 9, 900)]))
    tau = np.array([0.5, 1.0, 2.0])
    decays = np.exp(-time / tau[:, None])
    levels = np.array([[0.1, 0.2, 0.3], [0.6, 0.5, 0.4], [2.0, 0.005, 0.9]])
    truth = tau * np.log(1 / levels)
    truth[2, 0] = np.nan  # never so high
    found = last_crossings(time, decays, levels)
    assert (np.isnan(found.time) == np.isnan(truth)).all()
    there = ~np.isnan(truth)
    assert (np.abs(found.time - truth) <= found.uncertainty)[there].all()
    assert found.uncertainty[there].max() < 1e-4
    rising = first_crossings(time, 1 - decays, 1 - levels)
    truth[2, 0] = 0.0  # above from the first point on
    assert (np.abs(rising.time - truth) <= rising.uncertainty).all()
    assert rising.uncertainty[2, 0] == 0.0


def test_of_several_falls_and_rises_the_last_and_the_first_count():
    time = np.linspace(0, 2 * np.pi, 401)
    y = np.array([np.sin(time), np.sin(2 * time)])
    levels = np.full((1, 4), 0.5)
    found = last_crossings(time, np.concatenate([y, -y]), levels)
    truth = np.pi * np.array([5 / 6, 17 / 12, 11 / 6, 23 / 12])
    assert (np.abs(found.time[0] - truth) <= found.uncertainty[0]).all()
    sooner = first_crossings(time, np.concatenate([y, -y]), levels)
    truth = np.pi * np.array([1 / 6, 1 / 12, 7 / 6, 7 / 12])
    assert (np.abs(sooner.time[0] - truth) <= sooner.uncertainty[0]).all()


def test_a_peak_between_points_is_seen():
    time = np.arange(0, 12, 0.5) + 0.25
    y = np.exp(-0.05 * time) * np.cos(np.pi * time / 2)  # peaks near 0, 4, 8: between points
    level = 0.5 * (y[15:17].max() + np.exp(-0.4))  # below the peak near 8, above its points
    found = last_above(time, y, level)
    assert y[12:].max() < level
    grid = np.linspace(0, 12, 2_000_001)
    truth = grid[np.exp(-0.05 * grid) * np.cos(np.pi * grid / 2) > level][-1]
    assert abs(found.time - truth) <= found.uncertainty


def test_highest_finds_the_top_of_a_coarse_sine():
    time = np.linspace(0, 3, 31)
    rows = np.array([np.sin(time), np.cos(time), time])
    np.testing.assert_allclose(highest(time, rows)[0], [1.0, 1.0, 3.0], atol=3e-6)
    tops, doubts = highest(time, -rows)
    truth = np.array([0.0, -np.cos(3.0), 0.0])
    np.testing.assert_allclose(tops, truth, atol=3e-6)
    assert np.all(np.abs(tops - truth) <= doubts)


@settings(max_examples=40)
@given(
    period=st.floats(7, 60),
    phase=st.floats(0, 2 * np.pi),
    decay=st.floats(0, 0.05),
    jitter=st.integers(0, 1000),
    level=st.floats(0.05, 0.6),
)
def test_the_uncertainty_covers_the_truth_down_to_seven_points_a_period(
    period, phase, decay, jitter, level
):
    noise = np.random.default_rng(jitter).uniform(-0.2, 0.2, 80)
    time = np.arange(80.0) + noise

    def wave(t):
        return np.exp(-decay * t) * np.cos(2 * np.pi * t / period + phase)

    found = last_above(time, wave(time), level)
    grid = np.linspace(time[0], time[-1], 200_001)
    above = grid[wave(grid) > level]
    if found is None:
        assert above.size == 0 or wave(grid).max() - level < 0.05
    elif above.size and found.time < time[-1] and above[-1] < time[-1]:
        assert abs(found.time - above[-1]) <= found.uncertainty + 2 * (grid[1] - grid[0])
