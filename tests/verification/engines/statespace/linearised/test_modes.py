"""Modes of stiff matrices against 60 digits: every pole is as accurate as the matrix allows."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from spice_models.array_types import Complexes, Floats
from verification.engines.statespace.linearised.modes import decompose
from verification.engines.statespace.linearised.real_modes import EPS


def stiff(decades: float, seed: int, channels: int = 3) -> Floats:
    """Slow nodes that feed fast summing nodes, as op-amps of nearly infinite speed have them.

    T is close to rank one, so the slow poles are a difference of large terms, and close together.
    """
    rng = np.random.default_rng(seed)
    fast = 10.0**decades
    T = np.outer(rng.standard_normal(2), rng.standard_normal(channels))
    T += 1e-3 * rng.standard_normal(T.shape)
    slow, zero = -np.eye(channels), np.zeros((2, 2))
    return np.block(
        [
            [slow, np.zeros((channels, 2)), -30.0 * T.T],
            [-fast * T, -fast * np.eye(2), zero],
            [np.zeros((2, channels)), -40.0 * fast * np.eye(2), -40.0 * fast * np.eye(2)],
        ]
    )


def true_poles(A: Floats) -> Complexes:
    with mp.workdps(60):
        values, _ = mp.eig(mp.matrix(A.tolist()))
        return np.array([complex(value) for value in values])


@pytest.mark.parametrize("decades", [3.0, 9.0, 15.0])
@pytest.mark.parametrize("seed", range(4))
def test_slow_poles_do_not_lose_the_digits_of_the_fast_ones(decades: float, seed: int) -> None:
    A = stiff(decades, seed)
    modes, truth = decompose([A]), true_poles(A)
    off = np.abs(modes.poles[:, None] - truth).min(axis=1)
    assert np.all(off <= modes.spread)
    assert np.all(off <= 1e-10 * np.abs(modes.poles))
    assert modes.defect < 1e-9
    assert np.all(np.abs(modes.left @ modes.right - np.eye(len(A))) <= modes.defect + EPS)


def test_equal_poles_of_separate_parts_keep_a_basis() -> None:
    part = stiff(12.0, 1)
    zero = np.zeros_like(part)
    modes = decompose([np.block([[part, zero], [zero, part]])])
    assert modes.defect < 1e-9
    off = np.abs(modes.poles[:, None] - true_poles(part)).min(axis=1)
    assert np.all(off <= 1e-10 * np.abs(modes.poles))
