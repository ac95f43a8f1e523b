"""A settling time is the true one or none at all, over random five-channel networks."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.readings.measurements import measure
from taction.verification.readings.readings import Reading, rise_times, settling_times
from taction.verification.readings.ringing import ChannelRinging, Mode
from taction.verification.readings.settling import (
    ChannelState,
    Drift,
    prove,
    sustained,
)
from taction.verification.readings.signals import SampledSignal

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


def test_settle_reads_what_is_there():
    time = np.linspace(0, 1, 101)
    errors = np.array([1 - time, time, np.zeros(101), time - 1])
    falling, outside, still, rising = settling_times(SampledSignal(time, errors), 0.25)
    assert falling.value == pytest.approx(0.75, abs=1e-9)
    assert outside is None
    assert still.value == 0.0
    assert 0.0 < still.uncertainty < 1e-15
    assert rising == falling
    assert settling_times(SampledSignal(time, errors[1:2]), 0.25) == (None,)


def test_rises_of_channels_of_either_direction():
    """First-order steps: 10-90 % takes ``tau ln 9``, and one that is too slow has no rise time."""
    time = np.linspace(0, 12, 1201)
    tau, steps = np.array([0.5, 1.0, 20.0, 2.0]), np.array([1.0, -3.0, 1.0, -0.1])
    errors = -steps[:, None] * np.exp(-time / tau[:, None])
    quick, falling, slow, small = rise_times(SampledSignal(time, errors), steps, steps != 0)
    assert slow is None
    for reading, pace in ((quick, 0.5), (falling, 1.0), (small, 2.0)):
        assert abs(reading.value - pace * np.log(9)) <= reading.uncertainty < 1e-3
        assert not reading.fragile
    assert rise_times(SampledSignal(time, errors), steps, steps == 1e9) == (None,) * 4


def ringing(growth, sigma, amplitude=None):
    """A fitted ringing of 1 over a record of 1 s; `amplitude` is the envelope's."""
    mode = Mode(100.0, growth, (1.0,), sigma, 0.01, 0.0, 1.0)
    envelope = np.ones(20) if amplitude is None else amplitude
    time = np.linspace(0.0, 1.0, envelope.size)
    return ChannelRinging(time, envelope, 0.01, mode if amplitude is None else None, 1.0)


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
    judged = prove(Drift(time, error[None]), 0, Reading(0.2, 0.0), 0.5, 1.0, ringing(-1.0, 0.6))
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
