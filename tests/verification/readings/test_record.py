"""Crossings and peaks between points, and signals, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.readings.measurements import measure
from taction.verification.readings.record import RecordTrace, lagrange
from taction.verification.readings.trace import Crossings


@pytest.mark.parametrize("points", [2, 4, 6])
def test_polynomials_of_the_stencils_degree_are_exact(rng, points):
    time = np.cumsum(rng.uniform(0.5, 1.5, 40)) / 40
    powers = np.arange(points)
    at = np.concatenate([rng.uniform(time[0], time[-1], 100), time[[0, 7, -1]]])
    found = lagrange(time, time[:, None] ** powers, at, points)
    np.testing.assert_allclose(found, at[:, None] ** powers, atol=1e-12)


DECAY, OMEGA = 1.0, 6.0


def ringing(time):
    """Two channels, the second with twice the amplitude and the opposite sign."""
    first = np.exp(-DECAY * time) * np.cos(OMEGA * time)
    return np.stack([first, -2.0 * first])


def signals(points=8.0, begin=0.0, error=0.0):
    """The same record with and without its curve, `points` a period."""
    time = np.linspace(begin, begin + 8.0, int(8.0 * OMEGA / (2 * np.pi) * points))
    errors = ringing(time - begin)

    def curve(t, channel):
        return ringing(t - begin)[channel, np.arange(t.size)]

    return RecordTrace(time, errors, error), RecordTrace(time, errors, error, curve=curve)


@pytest.mark.parametrize("begin", [0.0, 5.0])
def test_the_last_crossing_is_that_of_the_waveform(begin):
    coarse, fine = signals(begin=begin)
    levels, shifts = np.array([0.1, 0.01]), np.zeros(2)
    about, found = (signal.last_outside(levels, shifts) for signal in (coarse, fine))
    widths = np.stack([last(coarse, level).uncertainty for level in levels])
    assert (widths > 1e-5).any()
    assert (found.uncertainty < 1e-10).all()
    for level, at in zip(levels, found.time, strict=True):
        assert np.abs(np.abs(ringing(at)).diagonal() - level).max() < 1e-10
    assert (np.abs(found.time - about.time) <= widths).all()


def test_a_bound_of_the_samples_shifts_the_level():
    _, fine = signals(error=1e-3)
    found = fine.last_outside(np.array([0.1, 0.1]), np.array([-1.0, 1.0]))
    assert np.abs(ringing(found.time[0])).diagonal() == pytest.approx([0.101] * 2, rel=1e-9)
    assert np.abs(ringing(found.time[1])).diagonal() == pytest.approx([0.099] * 2, rel=1e-9)


def test_a_channel_that_is_never_outside_has_no_crossing_to_refine():
    """The second channel is always within the level, and both are within 2: no curve is asked."""
    time = np.linspace(0.0, 8.0, 60)
    errors = np.stack([np.exp(-time), 0.4 * np.exp(-time)])

    def curve(t, channel):
        assert t.size
        assert not np.isnan(t).any()
        return np.stack([np.exp(-t), 0.4 * np.exp(-t)])[channel, np.arange(t.size)]

    signal = RecordTrace(time, errors, 0.0, curve=curve)
    found = signal.last_outside(np.array([0.5]), np.zeros(1))
    assert np.isnan(signal.last_outside(np.array([2.0]), np.zeros(1)).time).all()
    assert found.time[0, 0] == pytest.approx(np.log(2.0), rel=1e-9)
    assert np.isnan(found.time[0, 1])


def test_the_first_crossing_is_that_of_the_waveform():
    _, fine = signals()
    rows, steps, levels = np.array([1, 0]), np.array([2.0, -1.0]), np.array([0.1, 0.9])
    found = fine.first_reached(rows, steps, levels, np.zeros(2))
    assert (found.uncertainty < 1e-10).all()
    for level, at in zip(levels, found.time, strict=True):
        progress = 1.0 + ringing(at)[rows, [0, 1]] / steps
        assert progress == pytest.approx(level, abs=1e-9)


@pytest.mark.parametrize("points", [5.3, 8.0, 31.0])
def test_the_highest_peak_is_that_of_the_waveform(points):
    _, fine = signals(points)
    after = (np.pi - np.arctan(DECAY / OMEGA)) / OMEGA  # the first minimum of the first channel
    low = float(-ringing(np.array([after]))[0, 0])
    (up, doubt_up), (down, doubt_down) = fine.highest(1.0), fine.highest(-1.0)
    assert down[0] == pytest.approx(low, abs=1e-9)
    assert up[1] == pytest.approx(2.0 * low, abs=1e-9)
    assert max(doubt_up[1], doubt_down[0]) < 1e-8
    assert (up[0], down[1]) == (1.0, 2.0)  # the first points


def test_of_two_peaks_the_higher_one_counts_even_if_its_samples_are_lower():
    """Cosines: the sample at 0.5 is the highest, the peak at 2 pi is not sampled."""
    time = np.array([0.0, 0.5, 1.5, 3.0, 4.5, 5.6, 6.9, 8.0])

    def value(t):
        return np.where(t < 3.0, 0.9, 1.0) * np.cos(np.where(t < 3.0, t - 0.5, t - 2 * np.pi))

    fine = RecordTrace(time, value(time)[None], curve=lambda t, _: value(t))
    assert fine.highest(1.0)[0] == pytest.approx([1.0], abs=1e-9)


def test_a_measurement_takes_the_curve_of_its_record():
    time = np.linspace(0.0, 12.0, 90)
    u = 1.0 - ringing(time)[:1].T

    def curve(t, channel):
        return 1.0 - ringing(t)[channel, np.arange(t.size)]

    target = np.ones(1)
    about = measure(time, u, target).channels[0]
    found = measure(time, u, target, curve=curve).channels[0]
    for name in ("rise_time", "settling_time"):
        one, two = getattr(about, name), getattr(found, name)
        assert two.uncertainty < 1e-9 < one.uncertainty
        assert abs(one.value - two.value) <= one.uncertainty
    sharp, blurred = (each.readings["overshoot"].uncertainty for each in (found, about))
    assert sharp < 1e-8 < blurred


SHIFTS = np.array([0.0, -1.0, 1.0])


def last(trace, level):
    """The last instants outside a level, and how far those of the shifted trace are, per row."""
    found = trace.last_outside(np.full(3, level), SHIFTS)
    at, early, late = np.where(np.isnan(found.time), 0.0, found.time)
    width = np.maximum(late - at, at - early) + found.uncertainty.max(axis=0)
    return Crossings(found.time[0], width)


def test_a_step_after_a_plateau_makes_no_peak():
    """A cubic through the samples goes above the plateau; the waveform does not."""
    time = np.linspace(0.0, 2.0, 21)
    wave = np.minimum(1.0, 2.0 - time)
    trace = RecordTrace(time, wave[None])
    assert trace.highest(1.0)[0] == pytest.approx([1.0], abs=1e-12)
