"""Modes of stiff matrices and of boards' equations against 60 digits, and the sums they need."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.array_types import EPS, Complexes, Floats
from taction.verification.engines.statespace.linearised.find_modes import eigenvectors, mirrored
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.modes import _within
from taction.verification.engines.statespace.linearised.state_space import StateSpace
from taction.verification.engines.statespace.transients.exact import ModalFlow, exact_solution
from tests.support import nightly
from tests.support.boards import decompose, single_mode


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


def bounds_of(flow: ModalFlow, times: Floats) -> Floats:
    """Return bounds on the error of a flow at `times` (P,), (P, K)."""
    rates, lag, vague, omitted = flow.bound_terms
    left = np.exp(np.minimum(np.outer(times, rates), 700.0))
    return (times[:, None] * left) @ lag + left @ vague + omitted


def true_poles(A: Floats) -> Complexes:
    with mp.workdps(60):
        values, _ = mp.eig(mp.matrix(A.tolist()))
        return np.array([complex(value) for value in values])


@pytest.mark.parametrize("decades", [3.0, 9.0, 15.0])
@pytest.mark.parametrize("seed", range(2))
def test_a_transient_is_within_its_bounds(decades: float, seed: int) -> None:
    A = stiff(decades, seed)
    start = np.random.default_rng([seed, 1]).standard_normal(len(A))
    times = np.concatenate([[0.0], np.geomspace(0.01 / 10.0**decades, 10.0, 40)])
    flow = ModalFlow(decompose(A), np.eye(len(A)), start)
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
    off, bounds = np.abs(flow.at(times) - truth), bounds_of(flow, times)
    assert np.all(off <= bounds + 2.0 * np.spacing(np.abs(truth)))
    assert np.all(bounds <= flow.error * (1.0 + 1e-9))


@pytest.mark.parametrize("decades", [3.0, 9.0, 15.0])
@pytest.mark.parametrize("seed", range(2))
def test_slow_poles_are_known_beside_fast_ones(decades: float, seed: int) -> None:
    A = stiff(decades, seed)
    modes, truth = decompose(A), true_poles(A)
    off = np.abs(modes.poles[:, None] - truth).min(axis=1)
    assert np.all(off <= modes.pole_errors)
    assert np.all(modes.pole_errors <= 1e-6 * np.abs(modes.poles))
    assert modes.defect < 1e-9
    assert np.all(np.abs(modes.left @ modes.right - np.eye(len(A))) <= modes.defect + EPS)


def test_real_arithmetic_keeps_pairs_and_their_order_of_accuracy() -> None:
    # Poles over nine decades, the slow ones wanted to their own size.
    wanted = np.array([-1.0, -2.0 + 30.0j, -2.0 - 30.0j, -5e3, -1e5 + 4e6j, -1e5 - 4e6j, -3e9])
    blocks = np.zeros((7, 7))
    blocks[np.arange(7), np.arange(7)] = wanted.real
    for k in (1, 4):
        blocks[k, k + 1], blocks[k + 1, k] = wanted[k].imag, -wanted[k].imag
    turn = np.eye(7) + np.triu(np.random.default_rng(5).integers(-2, 3, (7, 7)), 1)
    scale = 10.0 ** np.arange(7)
    A = np.linalg.inv(turn) @ blocks @ turn * scale / scale[:, None]
    modes = decompose(A)
    assert modes.poles == pytest.approx(np.sort_complex(wanted)[::-1], rel=1e-5)
    assert modes.defect < 1e-12
    pairs = np.flatnonzero(modes.poles.imag > 0.0)
    assert np.array_equal(modes.right[:, pairs], modes.right[:, pairs + 1].conj())
    assert np.array_equal(modes.left[pairs], modes.left[pairs + 1].conj())


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
    solution = exact_solution(board)
    assert not space.modes.alone.all()
    drive = space.B.sum(axis=1)
    run = solve_ivp(
        lambda t, x: space.A @ x + drive, (0.0, 1e-5), np.zeros(space.n), "Radau", times,
        jac=space.A, rtol=1e-8, atol=1e-12,
    )  # fmt: skip
    C, D = space.rows(solution.nodes)
    wanted = (C @ run.y).T + D.sum(axis=1)
    assert np.abs(solution.at(times) - wanted).max() < 1e-6 * np.abs(wanted).max()


def linked_lags(count: int, pole: complex, spread: float, seed: int) -> Floats:
    """A chain of equal first- or second-order lags with slightly different rates."""
    rng = np.random.default_rng(seed)
    block = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]])
    cell = block if pole.imag else block[:1, :1]
    m = len(cell)
    A = np.kron(np.diag(1.0 + spread * rng.standard_normal(count)), cell)
    A += np.kron(np.eye(count, k=-1), abs(pole) * np.ones((m, m)))
    turn, _ = np.linalg.qr(rng.standard_normal((len(A), len(A))))
    return np.asarray(turn @ A @ turn.T)


@pytest.mark.parametrize("spread", [0.0, 1e-9, *nightly(1e-3)])
@pytest.mark.parametrize("pole", [-1.0 + 0.0j, -1.0 + 2.0j, -1.0 + 1e-9j])
@pytest.mark.parametrize("count", [2, 5])
def test_a_chain_of_lags_is_one_block(count: int, pole: complex, spread: float) -> None:
    """Against the exponential of the matrix with 60 digits; a slow mode beside them stays alone."""
    part = linked_lags(count, pole, spread, count)
    n = len(part)
    A = np.block([[part, np.zeros((n, 1))], [np.ones((1, n)), np.full((1, 1), -0.01)]])
    start = np.random.default_rng([count, 1]).standard_normal(n + 1)
    modes, times = decompose(A), np.array([0.0, 0.1, 1.0, 5.0, 20.0, 100.0])
    flow = ModalFlow(modes, np.eye(n + 1), start)
    with mp.workdps(60):
        matrix, column = mp.matrix(A.tolist()), mp.matrix(start.tolist())
        exact = [mp.expm(matrix * mp.mpf(t), method="taylor") * column for t in times.tolist()]
        truth = np.array([[float(x) for x in state] for state in exact])
    assert np.all(np.abs(flow.at(times) - truth) <= bounds_of(flow, times))
    assert flow.error < 1e-6
    assert modes.poles[0].real == pytest.approx(-0.01, rel=1e-12)
    assert modes.alone[0]
    assert modes.alone.sum() < n or spread == 1e-3


def exact(space: StateSpace) -> Complexes:
    """Return the poles of the stamped equations: by ``(M - K)^-1 M``, with 50 digits."""
    dense = space.descriptor.dense
    with mp.workdps(50):
        M, K = mp.matrix(dense.mass.tolist()), mp.matrix(dense.stiffness.tolist())
        listed, _ = mp.eig(mp.inverse(M - K) * M)
        finite = [value for value in listed if abs(value) > mp.mpf(10) ** -30]
        assert len(finite) == space.n
        return np.array([complex(1 - 1 / value) for value in finite])


def test_the_halves_of_a_mirrored_board_have_the_modes_of_the_whole() -> None:
    A = LinearBoard(synthesise(load_scene("scenes/paper-breadboard.toml"))).state_space.A.copy()
    mirror, (poles, vectors), true = mirrored(A), eigenvectors(A), np.linalg.eig(A)[0]
    assert mirror is not None
    assert np.count_nonzero(mirror != np.arange(len(A))) == 78
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(true), rel=1e-9)
    scale = np.abs(A) @ np.abs(vectors) + np.abs(vectors * poles)
    assert np.all(np.abs(A @ vectors - vectors * poles) <= 1e-11 * scale.max(axis=0))
    A[np.nonzero(A)[0][0], np.nonzero(A)[1][0]] *= 1.0 + 1e-9  # alike to 1e-9 is not equal
    assert mirrored(A) is None


@pytest.mark.parametrize("ratio", [0.5, 20.0, 60.0])
def test_the_bound_of_the_rightmost_pole_holds_beside_the_axis(ratio: float) -> None:
    space = LinearBoard(single_mode(ratio * 0.455e-6)).state_space
    lead, error = space.modes.poles[0], space.modes.pole_errors[0]
    assert np.abs(lead - exact(space)).min() <= error <= 1e-11 * abs(lead)


def test_a_bound_beyond_the_square_root_of_the_largest_number_is_finite() -> None:
    """Two poles at -1 and -2 with couplings of 1e200: the discs have the radius of their sum."""
    bound = _within(np.full((2, 2), 1e200), np.zeros(2, int), np.array([-1.0, -2.0], complex))
    assert np.all((bound >= 2e200) & (bound < 3e200))
