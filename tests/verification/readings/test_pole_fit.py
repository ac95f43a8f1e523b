"""Poles of sequences that are known."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.readings.mode_fit import _grams, fit_poles

POLES = np.array([0.98 * np.exp(0.9j), 1.01 * np.exp(0.35j), 0.93])


def sequence(n, channels, rng, poles=POLES):
    weights = rng.standard_normal((2, poles.size, channels))
    return ((poles ** np.arange(n)[:, None]) @ (weights[0] + 1j * weights[1])).real


def sorted_upper(z):
    return sorted(z[z.imag >= 0], key=lambda pole: pole.imag)


@pytest.mark.parametrize("n", [60, 300])
@pytest.mark.parametrize("channels", [1, 5])
def test_three_modes(rng, n, channels):
    z, moved = fit_poles(sequence(n, channels, rng))
    np.testing.assert_allclose(sorted_upper(z), sorted_upper(POLES), atol=1e-6)
    assert z.size == 5
    assert np.abs(moved).max() < 1e-5


def test_gram_matrices_are_those_of_the_windows(rng):
    samples = rng.standard_normal((47, 3))
    length = 15
    for gram, part in zip(
        _grams(samples, length), (samples, samples[11:], samples[:36]), strict=True
    ):
        windows = np.lib.stride_tricks.sliding_window_view(part, length, axis=0)
        rows = windows.reshape(-1, length)
        np.testing.assert_allclose(gram, rows.T @ rows, atol=1e-12)


def test_how_far_poles_move_is_what_fits_to_the_parts_say(rng):
    poles = np.array([0.998 * np.exp(0.9j), 1.001 * np.exp(0.35j)])
    samples = sequence(300, 4, rng, poles) + 1e-3 * rng.standard_normal((300, 4))
    z, moved = fit_poles(samples)
    parts = [fit_poles(part)[0] for part in (samples[75:], samples[:225])]
    for pole, by in zip(z, moved, strict=True):
        nearest = [part[np.argmin(np.abs(part - pole))] for part in parts]
        apart = np.abs(np.log(np.array(nearest) / pole).view(np.float64).reshape(2, 2)).max(axis=0)
        np.testing.assert_allclose([by.real, by.imag], apart, rtol=0.2)


def test_a_jump_at_the_end_leaves_the_poles_alone(rng):
    samples = sequence(300, 2, rng)
    samples[-1] += 100.0  # a window of its own: its vector has but a last element
    z, _ = fit_poles(samples)
    for pole in POLES:
        assert np.abs(z - pole).min() < 1e-6


def test_nothing_but_a_pulse():
    samples = np.zeros((60, 1))
    samples[10] = 1.0
    z, moved = fit_poles(samples)
    assert np.isfinite(z).all()
    assert np.isfinite(moved).all()
