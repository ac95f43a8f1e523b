"""Lambda of components, networks without capacitors, and the solver for straight pieces."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, log1p, sinh, tanh
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq, lsq_linear, nnls

from taction.netlist_gen.scene.scene import Scene
from taction.verification.reference.ideal_answer import (
    IdealNetwork,
    ideal_answer,
    ideal_network,
    lambda_times_resistance,
)
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve, solve_smooth, solve_square
from tests.support.making import make_scene, matrix_problem
from tests.support.oracle import error_of


def hilbert(N: int) -> NDArray[np.float64]:
    n = np.arange(1.0, N + 1)
    return 1.0 / (n[:, None] + n[None, :] - 1.0)


@pytest.mark.parametrize("N", [1, 3, 6, 8])
def test_lu_with_refinement_has_the_exact_solution(N: int) -> None:
    """At N = 8 the condition number is 1.5e10."""
    T, eps = hilbert(N), np.linspace(1.0, -2.0, N)
    found = solve_square(Problem(T, eps, 0.0))
    assert error_of(found) <= found.error_bound
    assert found.trusted
    assert found.error_bound <= 1e-7 * np.abs(found.u).max()
    assert found.certificate <= found.bound


@pytest.mark.parametrize("T", [np.ones((2, 2)), hilbert(14)])
def test_a_singular_matrix_is_not_trusted(T: NDArray[np.float64]) -> None:
    found = solve_square(Problem(T, np.ones(len(T)), 0.0))
    assert not found.trusted
    assert "singular to double precision" in found.reason


def scene(topology: str, **design: Any) -> Scene:
    return make_scene(design={"topology": topology, "unit_voltage": 2.0, **design})


@pytest.mark.parametrize("topology", ["inv", "pinv", "ridge"])
def test_the_network_of_a_topology_is_at_rest_at_once(topology: str) -> None:
    T, eps = np.array([[2.0, 1.0], [0.5, 1.0]]), np.array([1.0, -1.0])
    lam = 0.4 if topology == "ridge" else 0.0
    one = scene(topology, **({"lambda": lam} if lam else {}))
    network = ideal_network(matrix_problem(T, eps), one)
    assert (network.lam, network.RC) == (lam, 0.0)
    answer = ideal_answer(network, one)
    wanted = 2.0 * np.linalg.solve(T.T @ T + lam * np.eye(2), T.T @ eps)
    assert answer.target == pytest.approx(wanted, rel=1e-12)
    assert answer.problem == ""


G: dict[str, Callable[[float], float]] = {
    "linear": lambda x: x,
    "exponential": exp,
    "sinh": sinh,
    "softplus": lambda x: log1p(exp(x)),
    "tanh": tanh,
}
# Components of one channel with two sensors, SI units, all of them unlike 1.
R, S, G0, U0, VE = 1.7e6, 2.9e6, 0.43e-6, 0.6, 0.15
T, EPS = np.array([[1.3], [-0.4]]), np.array([0.9, 0.25])


def current(v: float, kind: str, biased: bool) -> float:
    """Current into the capacitor of the node, A: eq (9) as corrected, in SI units."""
    u = v if kind == "linear" else U0 * G[kind](v / VE)
    w = [S * G0 * (t * u - e * U0) for t, e in zip(T[:, 0].tolist(), EPS.tolist(), strict=True)]
    feedback = sum(t * G0 * volts for t, volts in zip(T[:, 0].tolist(), w, strict=True))
    return -v / R - biased * VE / R - feedback


@pytest.mark.parametrize(
    ("kind", "biased"), [("linear", False), *((k, b) for k in list(G)[1:] for b in (False, True))]
)
def test_the_rest_state_of_the_components_solves_the_problem(kind: str, biased: bool) -> None:
    v = brentq(current, -3.0, 3.0, args=(kind, biased), xtol=1e-15)
    product = lambda_times_resistance(kind, s=S, G0=G0, U0=U0, Ve=VE)
    network = IdealNetwork(T, EPS, product / R, R * 1e-11, U0, kind, VE, biased)
    u = U0 * solve(network.problem).u[0]
    assert u == pytest.approx(v if kind == "linear" else U0 * G[kind](v / VE), rel=1e-12)


def random_problem(seed: int, kind: str, ridge: float, bias: bool = False) -> Problem:
    rng = np.random.default_rng([27, seed])
    M = int(rng.integers(2, 12))
    N = int(rng.integers(1, M + 1))
    T, eps = rng.standard_normal((M, N)), 2.0 * rng.standard_normal(M)
    return Problem(T, eps, float(10.0 ** rng.uniform(-2.0, 1.0)), kind, bias, ridge)


KINDS = ("deadzone", "rectifier", "saturation")


def test_scipy_has_the_same_non_negative_and_bounded_answers() -> None:
    for seed in range(40):
        problem = random_problem(seed, "rectifier", 0.0)
        answer = solve(problem)
        assert answer.trusted
        assert answer.u == pytest.approx(nnls(problem.T, problem.eps)[0], abs=1e-10)
        boxed = solve(random_problem(seed, "saturation", 0.0))
        known = lsq_linear(problem.T, problem.eps, (-1.0, 1.0), tol=1e-14)
        assert boxed.u == pytest.approx(known.x, abs=1e-6)
        assert boxed.objective <= 2.0 * known.cost + 1e-12


@pytest.mark.parametrize("ridge", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("kind", KINDS)
def test_straight_pieces_are_within_the_error_bound(kind: str, ridge: float) -> None:
    for seed in range(2):
        answer = solve(random_problem(seed, kind, ridge))
        assert answer.trusted
        assert answer.certificate <= answer.bound
        assert error_of(answer) <= answer.error_bound


@pytest.mark.parametrize("kind", KINDS)
def test_newton_s_method_has_the_same_answer_with_the_whole_ridge_term(kind: str) -> None:
    for seed in range(20):
        problem = random_problem(seed, kind, 1.0, bias=True)
        assert solve(problem).u == pytest.approx(solve_smooth(problem).u, abs=1e-9)


def test_the_lasso_of_orthogonal_columns_is_a_soft_threshold() -> None:
    Q = np.linalg.qr(np.random.default_rng(5).standard_normal((6, 4)))[0]
    eps = Q @ np.array([3.0, -0.4, 0.9, -2.0])
    answer = solve(Problem(Q, eps, 1.6, "deadzone", ridge_share=0.0))  # threshold lam/2 = 0.8
    assert answer.u == pytest.approx([2.2, 0.0, 0.1, -1.2], abs=1e-14)
    assert answer.u[1] == 0.0
    # The input is u, and at least the threshold (in units of lam/2) where u is not 0.
    assert answer.v == pytest.approx([3.2, -0.5, 1.1, -2.2], abs=1e-13)


def test_the_lasso_of_more_channels_than_sensors_meets_its_conditions() -> None:
    """``T^T r`` is lam/2 times the sign of an entry, and at most lam/2 where the entry is 0."""
    rng = np.random.default_rng(8)
    for _ in range(40):
        T, eps, lam = rng.standard_normal((2, 5)), rng.standard_normal(2), 0.02
        answer = solve(Problem(T, eps, lam, "deadzone", ridge_share=0.0))
        force = T.T @ (eps - T @ answer.u) / (0.5 * lam)
        assert np.all(np.abs(force) <= 1.0 + 1e-9)
        assert force[answer.u != 0.0] == pytest.approx(np.sign(answer.u[answer.u != 0.0]), abs=1e-9)


def test_an_answer_that_is_not_unique_is_not_trusted() -> None:
    T, eps = np.ones((1, 2)), np.ones(1)
    answer = solve(Problem(T, eps, 1.0, "saturation", ridge_share=0.0))
    assert not answer.trusted
    assert "not unique" in answer.reason
    assert solve(Problem(T, eps, 1.0, "saturation", ridge_share=0.1)).trusted
