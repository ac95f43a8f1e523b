"""Modes of stiff matrices and of boards' equations against 60 digits, and the sums they need."""

from __future__ import annotations

from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Complexes, Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.elimination import (
    ReducedEquations,
    eliminate,
)
from taction.verification.engines.statespace.linearised.exactness import accurate_sum
from taction.verification.engines.statespace.linearised.modes import Modes, decompose
from taction.verification.engines.statespace.linearised.real_modes import EPS
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.engines.statespace.transients.matrix_exponential import ModalFlow


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
def test_a_transient_is_within_its_bounds(decades: float, seed: int) -> None:
    A = stiff(decades, seed)
    start = np.random.default_rng([seed, 1]).standard_normal(len(A))
    times = np.concatenate([[0.0], np.geomspace(0.01 / 10.0**decades, 10.0, 40)])
    flow = ModalFlow(decompose([A]), np.eye(len(A)), start)
    with mp.workdps(60):
        values, V = mp.eig(mp.matrix(A.tolist()))
        shares = mp.lu_solve(V, mp.matrix(start.tolist()))
        truth = np.array(
            [
                [complex(x).real for x in V * mp.matrix([mp.exp(p * t) * c for p, c in terms])]
                for t in times.tolist()
                for terms in [list(zip(values, shares, strict=True))]
            ]
        )
    off, bounds = np.abs(flow.at(times) - truth), flow.bounds(times)
    assert np.all(off <= bounds + 2.0 * np.spacing(np.abs(truth)))
    assert np.all(bounds <= flow.error * (1.0 + 1e-9))


@pytest.mark.parametrize("decades", [3.0, 9.0, 15.0])
@pytest.mark.parametrize("seed", range(4))
def test_slow_poles_do_not_lose_the_digits_of_the_fast_ones(decades: float, seed: int) -> None:
    A = stiff(decades, seed)
    modes, truth = decompose([A]), true_poles(A)
    off = np.abs(modes.poles[:, None] - truth).min(axis=1)
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


def chain(channels: int, C: float, gain: float) -> LinearBoard:
    """A board for first differences: equal op-amps drive one another in chains of equal poles."""
    T = np.eye(channels) - np.eye(channels, k=1)
    eps = T @ np.exp(-4.0 * np.linspace(-1.0, 1.0, channels) ** 2)
    scene = Scene.from_arrays(
        T, eps, capacitance=C, gain=gain, opamp="tl084", lam=0.02, unit_conductance="10uS"
    )
    return LinearBoard(synthesise(scene))


@pytest.mark.parametrize("gain", [2400.0, 6e6])
@pytest.mark.parametrize("C", [1e-12, 4e-12, 1.6e-11, 6.4e-11])
def test_no_step_leads_away_from_nearly_defective_modes(C: float, gain: float) -> None:
    """LAPACK's eigenvalues alone are backward stable; the slow ones are well conditioned."""
    space = chain(9, C, gain).state_space
    wanted = np.linalg.eigvals(space.A)
    found = space.modes.poles
    assert found[0].real == pytest.approx(wanted.real.max(), rel=1e-6)
    assert np.abs(found).max() == pytest.approx(np.abs(wanted).max(), rel=1e-6)


def test_a_board_of_nearly_defective_modes_has_its_transient() -> None:
    """Against a general solver of ordinary differential equations."""
    board = chain(6, 4e-12, 2400.0)
    space, times = board.state_space, np.array([1e-7, 1e-6, 1e-5])
    solution = exact_solution(board, stop=1e-5)
    assert not space.modes.defect < 1e-3
    drive = space.B.sum(axis=1)
    run = solve_ivp(
        lambda t, x: space.A @ x + drive, (0.0, 1e-5), np.zeros(space.n), "Radau", times,
        jac=space.A, rtol=1e-8, atol=1e-12,
    )  # fmt: skip
    C, D = space.rows(solution.nodes)
    wanted = (C @ run.y).T + D.sum(axis=1)
    assert np.abs(solution.at(times) - wanted).max() < 1e-6 * np.abs(wanted).max()


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
    sizes = np.abs(block.left) @ np.abs(block.right)
    assert (block.overlap.max(axis=1) <= 16.0 * EPS * sizes.max(axis=1)).all()


@pytest.mark.parametrize("spread", [0.0, 3.0, 8.0])
def test_a_residual_is_right_to_its_last_digits(spread: float) -> None:
    rng = np.random.default_rng(5)
    P = rng.standard_normal((6, 30)) * 10.0 ** rng.uniform(-spread, spread, (6, 1))
    Q = rng.standard_normal((30, 4)) * 10.0 ** rng.uniform(-spread, spread, (1, 4))
    inner = 10.0 ** rng.uniform(-spread, spread, 30)
    P, Q = P / inner, Q * inner[:, None]
    near = P @ Q
    found = accurate_sum([near], [(-P, Q)])
    for i, j in np.ndindex(*near.shape):
        terms = (Fraction(p) * Fraction(q) for p, q in zip(P[i], Q[:, j], strict=True))
        wanted = float(Fraction(near[i, j]) - sum(terms))
        scale = float(np.abs(P[i]) @ np.abs(Q[:, j]))
        assert found[i, j] == pytest.approx(wanted, rel=1e-9, abs=1e-26 * scale)


def test_nothing_is_no_sum() -> None:
    with pytest.raises(ValueError, match="nothing to add"):
        accurate_sum([], [])
