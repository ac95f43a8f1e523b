"""Modes of boards' equations before rounding, against 60 digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from taction.system.array_types import Complexes, Floats
from taction.verification.engines.statespace.linearised.elimination import (
    ReducedEquations,
    eliminate,
)
from taction.verification.engines.statespace.linearised.modes import Modes, decompose
from taction.verification.engines.statespace.linearised.real_modes import EPS

RANDOM = np.random.default_rng(7)
COUPLING = RANDOM.standard_normal((2, 6))


def pencil(channels: int, fast: float, detuning: float = 0.0) -> tuple[Floats, Floats]:
    """Slow nodes driven through fast op-amps (states), and summing nodes without capacitance.

    With a small `detuning` all channels are nearly equal, so their poles are close together.
    """
    n = 3 * channels
    slow, amps, nodes = (np.arange(channels) + k * channels for k in range(3))
    T = COUPLING[:, :channels].T @ COUPLING[:, :channels] if detuning == 0.0 else np.eye(channels)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    M[slow, slow], M[amps, amps] = 1.0 + detuning * np.arange(channels), 1.0 / fast
    K[slow, slow] = -1.0
    K[np.ix_(slow, amps)] = -0.3 * T
    K[amps, amps], K[amps, nodes] = -1.0, -1e5
    K[nodes, nodes] = -1.1
    K[np.ix_(nodes, amps)] = 0.1 * np.eye(channels)
    K[np.ix_(nodes, slow)] = -np.eye(channels)
    return M, K


def reduced(M: Floats, K: Floats) -> ReducedEquations:
    size = len(M)
    determined = np.zeros(size, dtype=np.bool_)
    return eliminate(M, K, np.zeros((size, 2)), determined, [f"z{k}" for k in range(size)])


def exact_matrix(M: Floats, K: Floats) -> mp.matrix:
    n = int(np.count_nonzero(M.any(axis=1)))
    A, B, C, D = (mp.matrix(part.tolist()) for part in (K[:n, :n], K[:n, n:], K[n:, n:], K[n:, :n]))
    return mp.inverse(mp.matrix(M[:n, :n].tolist())) * (A - B * mp.inverse(C) * D)


def matched(found: Complexes, true: list[mp.mpc]) -> list[tuple[int, mp.mpc]]:
    """Pair every pole found with the nearest true pole that is left."""
    left, pairs = list(true), []
    for k, pole in enumerate(found.tolist()):
        nearest = min(left, key=lambda each: abs(each - pole))
        left.remove(nearest)
        pairs.append((k, nearest))
    return pairs


def test_the_tail_is_what_rounding_took() -> None:
    M, K = pencil(3, 1e8)
    equations = reduced(M, K)
    assert equations.exactness is not None
    with mp.workdps(60):
        off = exact_matrix(M, K) - mp.matrix(equations.A.tolist())
        wanted = np.array(off.tolist(), dtype=np.float64)
    assert np.abs(wanted).max() > 0.0
    scale = np.abs(equations.A).max(axis=1, keepdims=True)
    assert (np.abs(equations.exactness.tail - wanted) <= EPS**1.5 * scale).all()


def modes_of(M: Floats, K: Floats, *, known: bool) -> Modes:
    equations = reduced(M, K)
    return decompose([equations.A], exactness=[equations.exactness] if known else None)


@pytest.mark.parametrize("fast", [1e3, 1e8, 1e12])
@pytest.mark.parametrize("channels", [1, 4])
def test_poles_are_right_to_the_last_digits(fast: float, channels: int) -> None:
    M, K = pencil(channels, fast)
    with mp.workdps(60):
        true, _ = mp.eig(exact_matrix(M, K))
        modes = modes_of(M, K, known=True)
        (block,) = modes.blocks
        assert block.noise is not None
        for k, pole in matched(block.poles, true):
            error = float(abs(pole - complex(block.poles[k])))
            assert error <= 8.0 * EPS * abs(block.poles[k])
            assert error <= block.noise[k, k] + 2.0 * EPS * abs(block.poles[k])


@pytest.mark.parametrize("detuning", [1e-6, 1e-9, 1e-12])
def test_close_poles_are_separated(detuning: float) -> None:
    M, K = pencil(3, 1e8, detuning)
    with mp.workdps(60):
        true, _ = mp.eig(exact_matrix(M, K))
        (block,) = modes_of(M, K, known=True).blocks
        for k, pole in matched(block.poles, true):
            bound = block.rounding()[k, k] + block.coupled.sum() + 2.0 * EPS * abs(block.poles[k])
            assert float(abs(pole - complex(block.poles[k]))) <= bound
    assert block.coupled.max() <= 1e-3 * detuning


def test_dual_vectors_are_dual_to_the_last_digits() -> None:
    M, K = pencil(4, 1e12)
    (block,) = modes_of(M, K, known=True).blocks
    assert block.overlap is not None
    sizes = np.abs(block.left) @ np.abs(block.right)
    assert (block.overlap.max(axis=1) <= 16.0 * EPS * sizes.max(axis=1)).all()
