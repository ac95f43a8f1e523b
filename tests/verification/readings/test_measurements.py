"""Measures of waveforms and of the network, and proofs of settling, with closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from taction.verification.readings.measurements import measure
from taction.verification.readings.readings import Reading, rise_times
from taction.verification.readings.record import RecordTrace
from taction.verification.readings.ringing import Mode, RecordRinging
from taction.verification.readings.settling import ChannelState, prove, sustained

ONE = np.ones(1)


def first_order(time, tau=1.0):
    return (1 - np.exp(-time / tau))[:, None]


def second_order(time, zeta):
    damped = np.sqrt(1 - zeta**2)
    turn = np.cos(damped * time) + zeta / damped * np.sin(damped * time)
    return (1 - np.exp(-zeta * time) * turn)[:, None]


def test_first_order_step_on_uneven_points():
    time = 10 * np.linspace(0, 1, 300) ** 1.5
    found = measure(time, first_order(time), ONE)
    channel = found.channels[0]
    assert found.amplitude == 1.0
    assert channel.state is ChannelState.SETTLED
    assert channel.reason == channel.rise_reason == found.reason == ""
    for reading, truth in (
        (channel.rise_time, np.log(9)),
        (channel.settling_time, np.log(100)),
        (found.settling_time, np.log(100)),
    ):
        assert abs(reading.value - truth) <= reading.uncertainty < 1e-3
        assert not reading.fragile
    assert channel.overshoot == 0.0
    assert channel.frequency is None


@pytest.mark.parametrize("zeta", [0.01, 0.2, 0.7])
def test_second_order_step(zeta):
    time = np.linspace(0, 7 / zeta, int(1500 / np.sqrt(zeta)))
    channel = measure(time, second_order(time, zeta), ONE).channels[0]
    assert channel.state is ChannelState.SETTLED
    assert channel.overshoot == pytest.approx(
        np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2)), abs=1e-5
    )
    fine = np.linspace(0, 7 / zeta, 2_000_001)
    late = fine[np.abs(second_order(fine, zeta)[:, 0] - 1) > 0.01][-1]
    assert abs(channel.settling_time.value - late) <= channel.settling_time.uncertainty + 1e-3
    if zeta < 0.5:
        assert channel.frequency == pytest.approx(np.sqrt(1 - zeta**2) / (2 * np.pi), rel=1e-5)
        assert channel.growth_rate == pytest.approx(-zeta, rel=1e-4)


@pytest.mark.parametrize("stop", [0.5, 4.0, 4.606])
def test_a_record_cut_short_has_no_settling_time(stop):
    time = np.linspace(0, stop, 500)
    channel = measure(time, first_order(time), ONE).channels[0]
    assert channel.state is ChannelState.NOT_SETTLED
    assert channel.settling_time is None
    assert "simulate longer" in channel.reason
    assert (channel.rise_time is None) == (stop < np.log(10))
    ringing = measure(time, second_order(10.0 * time, 0.1), ONE)
    assert ringing.settling_time is None


def test_a_record_before_its_expected_stop_settles_nothing():
    time = np.linspace(0, 10, 500)
    found = measure(time, first_order(time), ONE, expected_stop=20.0)
    assert found.settling_time is None
    assert "before 20.0 s" in found.reason


def test_passing_through_the_band_is_not_settling():
    time = np.linspace(0, 1.08 * np.log(1.1 / 0.11), 500)  # towards 1.1, now inside 1 +- 1 %
    channel = measure(time, 1.1 * first_order(time), ONE).channels[0]
    assert abs(channel.final - 1) < 0.01
    assert channel.state is ChannelState.NOT_SETTLED


def test_a_growing_oscillation():
    time = np.linspace(0, 200, 6000)
    u = first_order(time) + (1e-3 * np.exp(0.02 * time) * np.sin(3 * time))[:, None]
    channel = measure(time, u, ONE).channels[0]
    assert channel.state is ChannelState.OSCILLATING
    assert channel.frequency == pytest.approx(3 / (2 * np.pi), rel=1e-6)
    assert channel.growth_rate == pytest.approx(0.02, rel=1e-3)
    assert channel.settling_time is channel.rise_time is None


@pytest.mark.parametrize("size", [0.002, 0.3])
def test_a_sustained_oscillation_never_settles_inside_the_band_or_outside(size):
    time = np.linspace(0, 200, 6000)
    found = measure(time, first_order(time) + size * np.sin(3 * time)[:, None], ONE)
    channel = found.channels[0]
    assert channel.state is ChannelState.OSCILLATING
    assert found.reason == "channel 1: it oscillates and does not decay: it never settles"
    assert channel.settling_time is None
    assert channel.growth_rate == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("stop", "state"), [(17.9, ChannelState.SETTLED), (17.5, ChannelState.NOT_SETTLED)]
)
def test_a_ringing_below_half_the_band_at_the_end_need_not_last_three_periods(stop, state):
    """It is outside the band of 1 % until 15.3 s, and above half of it until 17.7 s."""
    time = np.linspace(0.0, stop, 2000)
    ringing = np.exp(-0.3 * time) * np.cos(2.0 * np.pi * time)
    channel = measure(time, 1.0 - ringing[:, None], ONE).channels[0]
    assert channel.state is state


def test_a_limit_cycle_is_clipped_with_the_growth_before_it():
    time = np.linspace(0, 100, 12000)
    u = first_order(time) + np.tanh(1e-4 * np.exp(0.12 * time) * np.sin(3 * time))[:, None]
    channel = measure(time, u, ONE).channels[0]
    assert channel.state is ChannelState.CLIPPED
    assert "at a constant amplitude" in channel.reason
    assert channel.frequency == pytest.approx(3 / (2 * np.pi), rel=1e-3)
    assert channel.growth_rate == pytest.approx(0.12, rel=0.01)


def test_divergence_is_typed():
    time = np.linspace(0, 50, 2000)
    good = first_order(time)[:, 0]
    broken = np.where(time > 40, np.nan, good)
    found = measure(time, np.column_stack([good, broken]), np.ones(2))
    assert [c.state for c in found.channels] == [ChannelState.NOT_SETTLED, ChannelState.DIVERGED]
    assert "channel 2 diverged" in found.channels[0].reason
    assert all(np.isfinite(c.final) for c in found.channels)
    infinite = measure(time, np.where(time > 40, np.inf, good)[:, None], ONE)
    assert infinite.channels[0].state is ChannelState.DIVERGED
    beyond = measure(time, (np.exp(0.1 * time) * np.sin(time))[:, None], ONE, bound=50.0)
    assert beyond.channels[0].state is ChannelState.DIVERGED
    assert beyond.channels[0].growth_rate == pytest.approx(0.1, rel=1e-3)
    runaway = measure(time, np.expm1(0.3 * time)[:, None], ONE)
    assert runaway.channels[0].state is ChannelState.DIVERGED
    nothing = measure(time, np.full((time.size, 1), np.nan), ONE)
    assert nothing.channels[0].state is ChannelState.DIVERGED


def test_antisymmetric_channels_and_a_zero_target():
    time = np.linspace(0, 60, 4000)
    shape = np.array([1.0, 0.0, -1.0])
    ring = np.exp(-0.2 * time) * np.sin(3 * time)
    target = np.array([2.0, 0.0, 2.0])
    u = first_order(time) * target + 0.5 * ring[:, None] * shape
    found = measure(time, u, target)
    left, middle, right = found.channels
    assert found.amplitude == 2.0
    assert middle.settling_time.value == 0.0
    assert middle.rise_time is None
    assert "own step" in middle.rise_reason
    assert middle.frequency is None
    assert left.frequency == pytest.approx(right.frequency) == pytest.approx(3 / (2 * np.pi))
    late = max(left.settling_time.value, right.settling_time.value)
    assert found.settling_time.value == late


def knife(time, first_peak):
    """A step whose first ringing peak is at `first_peak` near t = 1, and which then creeps up."""

    def wave(t, ring):
        return 1 - (1 - ring) * np.exp(-t / 5) - ring * np.exp(-t / 4) * np.cos(np.pi * t)

    fine = np.linspace(0.5, 1.5, 20001)
    ring = brentq(lambda a: wave(fine, a).max() - first_peak, 0.3, 0.6, xtol=1e-14)
    return wave(time, ring)[:, None]


def test_a_first_peak_on_the_knifes_edge_gives_both_values():
    time = np.linspace(0, 60, 6001)
    above, below = (
        measure(time, knife(time, peak), ONE).channels[0].rise_time for peak in (0.9001, 0.8999)
    )
    assert above.fragile
    assert below.fragile
    assert above.value < 1.0 < 2.0 < below.value
    assert above.alternative == pytest.approx(below.value, rel=0.02)
    assert below.alternative == pytest.approx(above.value, rel=0.1)
    clear = measure(time, knife(time, 0.93), ONE).channels[0].rise_time
    assert not clear.fragile


def test_a_peak_that_grazes_the_settling_band_gives_both_values():
    time = np.linspace(0, 60, 6001)
    zeta = 0.2
    peak = np.exp(-3 * np.pi * zeta / np.sqrt(1 - zeta**2))  # third extremum, above the target
    u = second_order(time, zeta)
    over, under = (
        measure(time, u, ONE, band=peak * side).channels[0].settling_time for side in (0.999, 1.001)
    )
    assert over.fragile
    assert under.fragile
    assert over.value > 1.1 * under.value
    assert over.alternative == pytest.approx(under.value, rel=0.03)
    assert under.alternative == pytest.approx(over.value, rel=0.03)


@settings(max_examples=25)
@given(zeta=st.floats(0.03, 0.9), points=st.integers(10, 40), seed=st.integers(0, 1000))
def test_coarse_sampling_is_covered_by_the_uncertainty(zeta, points, seed):
    stop = 9 / zeta + 25
    count = int(points * stop / (2 * np.pi))
    time = np.linspace(0, stop, count)
    step = time[1]
    time[1:-1] += np.random.default_rng(seed).uniform(-0.2, 0.2, count - 2) * step
    channel = measure(time, second_order(time, zeta), ONE).channels[0]
    fine = np.linspace(0, stop, 400_001)
    exact = second_order(fine, zeta)[:, 0]
    settled = fine[np.abs(exact - 1) > 0.01][-1]
    rise = fine[exact > 0.9][0] - fine[exact > 0.1][0]
    grain = 2 * fine[1]
    assert abs(channel.settling_time.value - settled) <= channel.settling_time.uncertainty + grain
    assert abs(channel.rise_time.value - rise) <= channel.rise_time.uncertainty + grain


SUSTAINED = (ChannelState.OSCILLATING, ChannelState.CLIPPED, ChannelState.DIVERGED)


def network(rng):
    """Return a decaying response (function of time), its record's end and its points."""
    reals = -(10 ** rng.uniform(-1, 1, rng.integers(1, 4)))
    pace = 10 ** rng.uniform(0.3, 1.5, rng.integers(0, 3))
    poles = np.concatenate([reals, (-(10 ** rng.uniform(-2.5, -0.5, pace.size)) + 1j) * pace])
    shape = rng.normal(size=(poles.size, 5)) * np.where(poles.imag > 0, 0.3, 1.0)[:, None]
    shape = shape * np.exp(1j * rng.uniform(0, 6.28, poles.size) * (poles.imag > 0))[:, None]
    end = 9 / np.abs(poles.real).min()
    points = int(np.clip(6.4 * end * max(1.0, pace.max(initial=1.0)), 400, 60000))
    return lambda t: 1 + (np.exp(t[:, None] * poles) @ shape).real, end, points


@pytest.mark.parametrize("seed", range(6))
def test_the_settling_time_is_right_or_absent(seed):
    response, end, points = network(np.random.default_rng(seed))
    time = np.linspace(0, end, points)
    u, target = response(time), np.ones(5)
    amplitude = np.abs(u[0] - 1).max()
    rough = time[np.abs(u - 1).max(axis=1) > 0.01 * amplitude][-1]
    fine = np.linspace(0.9 * rough, 1.1 * rough, 200_001)
    truth = fine[np.abs(response(fine) - 1).max(axis=1) > 0.01 * amplitude][-1]
    for fraction in (0.6, 0.98, 1.02, 1.1, 1.8):
        part = time <= truth * fraction
        found = measure(time[part], u[part], target)
        assert not any(c.state in SUSTAINED for c in found.channels)
        if fraction < 1.05:
            assert found.settling_time is None
        elif found.settling_time is None:
            assert fraction < 1.5
            assert "simulate" in found.reason
        else:
            error = abs(found.settling_time.value - truth)
            assert error <= found.settling_time.uncertainty + 2 * (fine[1] - fine[0])


def test_rises_of_channels_of_either_direction():
    """First-order steps: 10-90 % takes ``tau ln 9``, and one that is too slow has no rise time."""
    time = np.linspace(0, 12, 1201)
    tau, steps = np.array([0.5, 1.0, 20.0, 2.0]), np.array([1.0, -3.0, 1.0, -0.1])
    errors = -steps[:, None] * np.exp(-time / tau[:, None])
    quick, falling, slow, small = rise_times(RecordTrace(time, errors), steps, steps != 0)
    assert slow is None
    for reading, pace in ((quick, 0.5), (falling, 1.0), (small, 2.0)):
        assert abs(reading.value - pace * np.log(9)) <= reading.uncertainty < 1e-3
        assert not reading.fragile
    assert rise_times(RecordTrace(time, errors), steps, steps == 1e9) == (None,) * 4


def ringing(growth, sigma, amplitude=None):
    """A fitted ringing of 1 over a record of 1 s; `amplitude` is the envelope's."""
    mode = Mode(100.0, growth, (1.0,), sigma, 0.01, 0.0, 1.0)
    envelope = np.ones(20) if amplitude is None else amplitude
    time = np.linspace(0.0, 1.0, envelope.size)
    return RecordRinging(time, envelope, 0.01, mode if amplitude is None else None)


@pytest.mark.parametrize(
    ("growth", "sigma", "state"),
    [
        (0.0, 0.0, ChannelState.OSCILLATING),
        (-3e-15, 1e-18, ChannelState.OSCILLATING),  # rounding has either sign
        (3e-15, 1e-18, ChannelState.OSCILLATING),
        (-1e-3, 1e-5, None),  # slow, but beyond doubt
        (-1e-3, 1e-3, ChannelState.OSCILLATING),  # at the most 0.3 % of it is lost
        (-1.0, 0.6, ChannelState.UNDECIDED),
        (0.1, 0.4, ChannelState.UNDECIDED),
        (-1.0, 0.2, None),
        (1.0, 0.1, ChannelState.OSCILLATING),
    ],
)
def test_ringing_persists_by_what_it_loses_over_the_record(growth, sigma, state):
    time = np.linspace(0.0, 1.0, 2000)
    error = np.sin(2 * np.pi * 100 * time)
    assert sustained(time, error, 0.5, ringing(growth, sigma)) is state


def test_an_undecided_ringing_states_both_readings():
    time = np.linspace(0.0, 1.0, 2000)
    error = 0.1 * np.sin(2 * np.pi * 100 * time)
    judged = prove(time, error, Reading(0.2, 0.0), 0.5, 1.0, ringing(-1.0, 0.6))
    assert judged.state is ChannelState.UNDECIDED
    assert judged.settling_time is None
    assert "if it decays, the settling time is 0.2 s" in judged.reason
    assert "if it does not, it never settles" in judged.reason


def test_a_scattered_envelope_does_not_decide():
    time = np.linspace(0.0, 1.0, 2000)
    error = np.sin(2 * np.pi * 100 * time)
    fall = np.exp(-0.3 * np.linspace(0.0, 2.0, 20))
    assert sustained(time, error, 0.5, ringing(0, 0, fall)) is None
    rough = fall * np.where(np.arange(20) % 2, 1.2, 0.8)
    assert sustained(time, error, 0.5, ringing(0, 0, rough)) is ChannelState.UNDECIDED
