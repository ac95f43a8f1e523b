"""The solver for straight pieces against SciPy, closed forms and another method of this package."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear, nnls

from taction.system.errors import InputError
from taction.verification.reference.problem import Problem
from taction.verification.reference.smooth import solve_smooth
from taction.verification.reference.solve import solve
from tests.support.piecewise_boards import KINDS, proximal


def random_problem(seed: int, kind: str, ridge: float, bias: bool = False) -> Problem:
    rng = np.random.default_rng([27, seed])
    M = int(rng.integers(2, 12))
    N = int(rng.integers(1, M + 1))
    T, eps = rng.standard_normal((M, N)), 2.0 * rng.standard_normal(M)
    return Problem(T, eps, float(10.0 ** rng.uniform(-2.0, 1.0)), kind, bias, ridge)


@pytest.mark.parametrize("seed", range(4))
def test_scipy_has_the_same_non_negative_and_bounded_answers(seed: int) -> None:
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
def test_a_proximal_gradient_ends_within_the_error_bound(kind: str, ridge: float) -> None:
    for seed in range(2):
        problem = random_problem(seed, kind, ridge)
        answer = solve(problem)
        assert answer.trusted
        assert answer.certificate <= answer.bound
        other = proximal(problem.T, problem.eps, problem.lam, kind, ridge)
        assert answer.u == pytest.approx(other, abs=answer.error_bound + 1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_newton_s_method_has_the_same_answer_with_the_whole_ridge_term(kind: str) -> None:
    problem = random_problem(3, kind, 1.0, bias=True)
    assert solve(problem).u == pytest.approx(solve_smooth(problem).u, abs=1e-9)


def test_the_lasso_of_orthogonal_columns_is_a_soft_threshold() -> None:
    Q = np.linalg.qr(np.random.default_rng(5).standard_normal((6, 4)))[0]
    eps = Q @ np.array([3.0, -0.4, 0.9, -2.0])
    answer = solve(Problem(Q, eps, 1.6, "deadzone", ridge_share=0.0))  # threshold lam/2 = 0.8
    assert answer.u == pytest.approx([2.2, 0.0, 0.1, -1.2], abs=1e-14)
    assert answer.u[1] == 0.0
    # The input is u, and at least the threshold (in units of lam/2) where u is not 0.
    assert answer.v == pytest.approx([3.2, -0.5, 1.1, -2.2], abs=1e-13)


def test_an_answer_that_is_not_unique_is_not_trusted() -> None:
    T, eps = np.ones((1, 2)), np.ones(1)
    answer = solve(Problem(T, eps, 1.0, "saturation", ridge_share=0.0))
    assert not answer.trusted
    assert "not unique" in answer.reason
    assert solve(Problem(T, eps, 1.0, "saturation", ridge_share=0.1)).trusted


def test_a_share_of_the_ridge_term_needs_straight_pieces() -> None:
    with pytest.raises(InputError, match="ridge"):
        Problem(np.eye(2), np.ones(2), 1.0, "tanh", ridge_share=0.5)
    with pytest.raises(InputError, match="ridge"):
        Problem(np.eye(2), np.ones(2), 1.0, "deadzone", ridge_share=1.5)
