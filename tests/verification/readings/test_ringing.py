"""Overshoot and undershoot by their definition, and ringing of transients whose poles are known."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.readings.readings import Step, excursions
from taction.verification.readings.record import RecordTrace
from taction.verification.readings.ringing import (
    GOOD_FIT,
    Mode,
    find_growth,
    find_ringing,
    saturates,
    slows,
)

F0 = 123456.0
SHAPE = np.array([1, -0.5, 0.3, 0, -0.3, 0.5, -1])  # antisymmetric: the channels' sum is zero


def uneven(rng, stop=1e-3, points=20001):
    time = np.linspace(0, stop, points)
    time[1:-1] += rng.uniform(-0.3, 0.3, points - 2) * stop / points
    return time


def fitted(time, signals) -> Mode:
    """Return the mode of a record, which must ring."""
    mode = find_ringing(time, signals).mode
    assert mode is not None
    return mode


def ring(time, growth, frequency=F0, phase=0.0):
    return np.exp(growth * time) * np.cos(2 * np.pi * frequency * time + phase)


@pytest.mark.parametrize("growth", [-2040.8, -50.0, 0.0, 100.0, 1e4])
def test_one_antisymmetric_mode_on_a_step_and_uneven_points(rng, growth):
    time = uneven(rng)
    signals = (1 - np.exp(-time / 18e-6))[:, None] + 1e-3 * ring(time, growth)[:, None] * SHAPE
    mode = fitted(time, signals)
    assert (mode.grows, mode.decays) == (growth > 0.0, growth < 0.0)
    assert mode.frequency == pytest.approx(F0, rel=1e-7)
    assert mode.growth_rate == pytest.approx(growth, abs=1e-6 * F0)
    assert mode.growth_sigma < 1e-4 * F0
    # 20 points a period: sixth-order interpolation leaves about 1e-5 of the ringing.
    expected = 1e-3 * np.exp(growth * mode.stop) * np.abs(SHAPE)
    np.testing.assert_allclose(mode.channels, expected, atol=1e-3 * expected.max())


def test_of_two_modes_two_per_cent_apart_the_lasting_one_is_within_its_uncertainty(rng):
    time = uneven(rng)
    first, second = ring(time, -900.0), ring(time, -8000.0, 1.02 * F0)
    mode = fitted(time, np.column_stack([first + second, first - 0.5 * second]))
    assert mode.frequency == pytest.approx(F0, rel=1e-3)
    assert abs(mode.growth_rate + 900.0) < 2.0 * mode.growth_sigma < 600.0


@pytest.mark.parametrize("periods", [4, 5, 7, 9])
@pytest.mark.parametrize("phase", [0.0, 0.7, 2.0, 3.0])
def test_a_short_record_does_not_hide_a_growing_mode_behind_a_fading_one(periods, phase):
    """The two ring at nearly one frequency, as modes of a board near its onset."""
    time = np.linspace(0, periods / F0, 2001)
    grows, fades = ring(time, 500.0), ring(time, -17e3, 0.995 * F0, phase)
    shares = np.outer(grows, [0.4, 0.2]) + np.outer(fades, [0.2, -0.05])
    mode = fitted(time, shares)
    assert not mode.decays or mode.residual > GOOD_FIT
    later = fitted(time + 1e-3, 1e-6 * shares)  # neither the begin nor the unit matters
    for name in ("growth_rate", "growth_sigma"):
        assert getattr(later, name) == pytest.approx(getattr(mode, name), rel=1e-5)


def test_noise_is_covered_by_sigma(rng):
    time = uneven(rng)
    pulls = []
    for _ in range(40):
        noisy = ring(time, -900.0)[:, None] + 1e-3 * rng.standard_normal((time.size, 2))
        mode = fitted(time, noisy)
        pulls.append((mode.growth_rate + 900.0) / mode.growth_sigma)
        assert mode.frequency == pytest.approx(F0, rel=1e-3)
    assert 0.4 < np.sqrt(np.mean(np.square(pulls))) < 1.3  # neither boastful nor useless


def test_only_the_stretch_before_saturation_is_fitted():
    time = np.linspace(0, 2.5e-3, 50001)
    mode = fitted(time, np.tanh(1e-4 * ring(time, 6e3))[:, None])
    assert mode.growth_rate == pytest.approx(6e3, rel=1e-4)
    assert mode.frequency == pytest.approx(F0, rel=1e-6)
    assert mode.stop < np.log(0.5 / 1e-4) / 6e3
    assert mode.doubt == ""


def uneven_periods(rng, points, periods=60):
    return uneven(rng, periods / F0, round(points * periods) + 1)


@pytest.mark.parametrize("clipped", [0.03, 0.2, 0.6])  # of the record
@pytest.mark.parametrize("points", [8.1, 25.0])  # a period
def test_seven_channels_at_hard_rails(rng, points, clipped):
    """Modes of either sign, in phase or not: no clipped end, harmonic or kink of it leads."""
    for turned in (0.0, 1.0):
        even = np.linspace(0, 60 / F0, round(60 * points) + 1)
        for time in (even, uneven_periods(rng, points)):
            onset = (1 - clipped) * time[-1]
            growth = 7.0 / onset
            shares = rng.uniform(0.3, 1.0, 7) * rng.choice([-1.0, 1.0], 7)
            phases = turned * rng.uniform(0, 2 * np.pi, 7)
            grown = np.exp(growth * (time - onset))[:, None]
            signals = np.clip(
                grown * shares * np.cos(2 * np.pi * F0 * time[:, None] + phases), -1, 1
            )
            mode = fitted(time, signals)
            assert mode.doubt == ""
            assert mode.frequency == pytest.approx(F0, rel=1e-3)
            assert mode.growth_rate == pytest.approx(growth, rel=2e-2)
            if clipped >= 0.2:
                assert mode.stop < onset
                assert mode.growth_rate == pytest.approx(growth, rel=3e-3)


def test_a_limit_cycle_reached_at_once_casts_doubt():
    time = np.linspace(0, 1e-3, 20001)
    mode = fitted(time, np.tanh(0.3 * ring(time, 3e4))[:, None])
    assert mode.doubt != ""


def test_a_faded_ringing_is_fitted_where_it_was_still_there(rng):
    time = uneven(rng)
    signal = ring(time, -2e4) + 1e-7 * rng.standard_normal(time.size)
    mode = fitted(time, signal[:, None])
    assert mode.stop < 0.5e-3
    assert mode.growth_rate == pytest.approx(-2e4, rel=1e-3)


@pytest.mark.parametrize("gone", [2e-5, 1e-4, 4e-4])
def test_the_rate_of_what_vanishes_in_one_window_is_not_known(gone):
    time = np.linspace(0, 1e-3, 20001)
    mode = find_growth(time, np.where(time < gone, np.exp(-2e4 * time), 0.0)[:, None])
    assert mode is None or mode.decays or "sign of the growth rate" in mode.doubt


def test_envelope_follows_the_amplitude_under_a_trend():
    time = np.linspace(0, 1e-3, 20001)
    found = find_ringing(time, (1 - np.exp(-time / 18e-6) + 1e-2 * ring(time, -1000.0))[:, None])
    assert found.period == pytest.approx(1 / F0, rel=1e-3)
    late = found.time > 2e-4
    expected = 1e-2 * np.exp(-1000.0 * found.time[late])
    np.testing.assert_allclose(found.amplitude[late, 0], expected, rtol=0.05)


@pytest.mark.parametrize("growth", [-5e3, 0.0, 5e3])
@pytest.mark.parametrize("points", [1001, 2501, 6201])  # 8, 20 and 50 a period
def test_the_period_of_a_tone_that_decays_or_grows_is_exact(points, growth):
    time = np.linspace(0, 1e-3, points)
    found = find_ringing(time, ring(time, growth, phase=0.4)[:, None])
    assert found.period == pytest.approx(1 / F0, rel=3e-6)


def test_a_clipped_wave_counts_with_its_fundamental_and_its_harmonics():
    time = np.linspace(0, 1e-3, 3087)  # 25 points a period
    square = np.sign(ring(time, 0.0)) * np.minimum(np.abs(20.0 * ring(time, 0.0)), 1.0)
    found = find_ringing(time, square[:, None])
    fundamental = 4.0 / np.pi
    harmonics = np.sqrt(2.0 * (1.0 - fundamental**2 / 2.0))
    np.testing.assert_allclose(found.amplitude, fundamental + harmonics, rtol=0.1)


@pytest.mark.parametrize("onset", [0.65, 0.7, 0.75])  # of clipping, in the record
def test_a_ringing_that_starts_and_clips_on_the_way_keeps_its_period(onset):
    time = np.linspace(0, 40 / F0, 1001)
    for growth in (5, 8, 12, 20):
        for phase in (0.0, 0.7, 1.4, 2.1):
            grown = np.exp(growth * (time / time[-1] - onset))
            signal = np.clip(grown * ring(time, 0.0, phase=phase), -1, 1)
            assert find_ringing(time, signal[:, None]).period == pytest.approx(1 / F0, rel=2e-3)


def test_saturation_needs_growth_and_then_a_plateau():
    x = np.linspace(0, 1, 40)
    jagged = np.tanh(1e-3 * np.exp(20 * x)) * (1 + 0.035 * (-1.0) ** np.arange(40))
    assert saturates(jagged)
    assert not saturates(np.abs(np.sin(4.6 * x)) + 0.3 * np.sin(4.6 * x) ** 4)  # beats
    assert saturates(np.tanh(1e-3 * np.exp(20 * x)))
    assert not saturates(np.exp(3 * x))
    assert not saturates(np.ones(40))


@pytest.mark.parametrize("late", [0.15, 0.05])
def test_growth_slows_where_its_rate_falls_to_less_than_half(late):
    """By so many nepers a window in the last eight, and 0.2 in those before."""
    nepers = np.cumsum([0.2] * 24 + [late] * 8)
    before = np.count_nonzero(nepers < nepers[-1] - np.log(4.0))
    assert slows(np.exp(nepers)) == (before if late < 0.1 else 0)


TIME = np.linspace(0.0, 20.0, 2001)


def swings(*channels: tuple[float, float, float]) -> tuple[RecordTrace, Step]:
    """Channels ``(start, target, swing)``: a monotone step plus ``swing (exp(-t) - exp(-2 t))``."""
    start, target, swing = np.array(channels).T[:, :, None]
    there = 1.0 - np.exp(-10.0 * TIME)
    u = start + (target - start) * there + 4.0 * swing * (np.exp(-TIME) - np.exp(-2.0 * TIME))
    return RecordTrace(TIME, u - target), Step(start[:, 0], target[:, 0])


def read(*channels: tuple[float, float, float]) -> tuple[list[float], list[float]]:
    over, under = excursions(*swings(*channels)).values()
    return [found.value for found in over], [found.value for found in under]


def bounds(signal: RecordTrace, step: Step) -> list[list[float]]:
    return [[found.uncertainty for found in kind] for kind in excursions(signal, step).values()]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("offset", [0.0, 3.0])
def test_each_excursion_has_its_own_side(sign: float, offset: float) -> None:
    """A swing beyond the target is overshoot, a swing beyond the start undershoot."""
    big = (offset, offset + sign, 0.0)  # the network's step is 1
    level, away = offset + 0.5 * sign, -0.8 * sign
    over, under = read(big, (offset, level, 0.5 * sign), (offset, level, away))
    assert max(over[0], under[0]) < 1e-15
    assert over[1] == pytest.approx(0.5, abs=1e-3)  # the step is over at the peak
    assert max(under[1], over[2]) < 1e-15
    assert under[2] == pytest.approx(0.3, abs=1e-2)


@pytest.mark.parametrize("size", [0.04, -0.04])
@pytest.mark.parametrize("swing", [0.3, -0.3])
def test_a_small_step_overshoots_on_either_side_of_its_interval(size: float, swing: float) -> None:
    over, under = read((0.0, 1.0, 0.0), (0.0, size, swing))
    ahead = np.sign(size) == np.sign(swing)
    beyond = 0.3 if ahead else 0.3 - abs(size)  # of the target, of the start
    assert over[1] == pytest.approx(beyond, abs=1e-3)
    assert under[1] == pytest.approx(0.0 if ahead else over[1], abs=1e-3)


def test_every_channel_has_bounds_of_its_own() -> None:
    """Each bound is that of the channel's samples; an excursion of 0 is uncertain upwards only."""
    signal, step = swings((0.0, 1.0, 0.0), (0.0, 0.5, 0.5), (0.0, 0.5, -0.8))
    known = RecordTrace(signal.every, signal.samples, error=0.01)
    over, under = bounds(known, step)
    assert 0.0 < over[0] <= 0.01 * (1.0 + 1e-9)
    assert over[1] == pytest.approx(0.01, rel=1e-3)
    assert under[2] == pytest.approx(0.01, rel=1e-3)
    exact, _ = bounds(signal, step)
    assert all(0.0 < bound < 1e-4 for bound in exact)


@pytest.mark.parametrize("rate", [1.5, 1.7, 2.0])
@pytest.mark.parametrize("decay", [2.31, 2.49])
def test_an_approach_on_few_points_is_no_ringing_larger_than_its_chords(rate, decay):
    """A line that few points leave in the spectrum, from which the fit of a tone runs away."""
    steps = 1e-7 * rate ** np.arange(60)
    head = np.append(0.0, np.cumsum(steps[steps < 1.0]))
    time = np.arange(head[-1] + 1.0, 17.0)
    time = np.concatenate([head, time])
    found = find_ringing(time, (1.0 - np.exp(-decay * time))[:, None])
    assert found.amplitude.max() < 0.05
    assert found.mode is None or found.mode.channels[0] < 0.05
