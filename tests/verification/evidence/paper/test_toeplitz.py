"""Toeplitz problems against the dense solver, and the bound they claim."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz

from taction.system.errors import InputError
from taction.verification.evidence.paper.toeplitz import ToeplitzMatrix, solve_toeplitz_problem
from taction.verification.reference.problem import Problem, Solution, ToeplitzProblem
from taction.verification.reference.solve import solve


def tactile(channels: int, spacing: float, lam: float, regulariser: str) -> ToeplitzProblem:
    y = spacing * np.arange(channels)
    column = 1.5 / np.pi * (1.0 - y * y) / (1.0 + y * y) ** 2
    stress = np.maximum(0.0, np.sin(y / 7.3) + 0.5 * np.sin(y / 3.1 + 1.0) - 0.5)
    noise = 0.1 * np.random.default_rng(0).standard_normal(channels)
    eps = ToeplitzMatrix(column, column).product(stress) + noise
    return ToeplitzProblem(column, column, eps, lam, regulariser)


def dense(problem: ToeplitzProblem) -> Solution:
    T = toeplitz(problem.column, problem.row)
    return solve(Problem(T, problem.eps, problem.lam, problem.regulariser, problem.bias))


@pytest.mark.parametrize("size", [1, 2, 7, 30])
def test_products(rng: np.random.Generator, size: int) -> None:
    column, row, x = rng.standard_normal((3, size))
    row[0] = column[0]
    fast, full = ToeplitzMatrix(column, row), toeplitz(column, row)
    assert fast.product(x) == pytest.approx(full @ x, abs=1e-13)
    assert fast.transposed(x) == pytest.approx(full.T @ x, abs=1e-13)
    assert fast.norm >= np.linalg.norm(full, 2) * (1 - 1e-12)


@pytest.mark.parametrize("regulariser", ["linear", "exponential", "sinh", "softplus", "tanh"])
@pytest.mark.parametrize("lam", [10.0, 0.1, 1e-3])
def test_agrees_with_the_dense_solver(regulariser: str, lam: float) -> None:
    problem = tactile(150, 0.5, lam, regulariser)
    answer, wanted = solve_toeplitz_problem(problem), dense(problem)
    assert answer.trusted
    assert wanted.trusted
    error = float(np.max(np.abs(answer.u - wanted.u)))
    assert error <= answer.error_bound <= 1e-6 * float(np.max(np.abs(wanted.u)))
    assert answer.objective == pytest.approx(wanted.objective, rel=1e-9)


def test_levinson_needs_one_solve_and_is_exact_to_rounding() -> None:
    problem = tactile(400, 0.5, 0.01, "linear")
    answer = solve_toeplitz_problem(problem, tolerance=1e-9)
    assert answer.trusted
    assert answer.iterations <= 2
    assert answer.u == pytest.approx(dense(problem).u, abs=1e-11)


def test_skew_and_unsymmetric_kernels(rng: np.random.Generator) -> None:
    y = 0.5 * np.arange(80)
    skew = 1.5 / np.pi * y * (1.0 - y * y) / (1.0 + y * y) ** 2
    for row in (-skew, 0.3 * skew):
        for regulariser in ("linear", "exponential"):
            eps = rng.standard_normal(80)
            problem = ToeplitzProblem(skew, row, eps, 0.05, regulariser)
            answer = solve_toeplitz_problem(problem)
            assert answer.trusted
            assert answer.u == pytest.approx(dense(problem).u, abs=answer.error_bound + 1e-15)


def test_bias_and_scale() -> None:
    base = tactile(60, 1.0, 0.1, "exponential")
    small = ToeplitzProblem(
        1e-12 * base.column, 1e-12 * base.row, 1e-12 * base.eps, 1e-25, "exponential", bias=True
    )
    answer = solve_toeplitz_problem(small)
    assert answer.trusted
    assert answer.u == pytest.approx(dense(small).u, abs=answer.error_bound)


def test_twenty_thousand_channels() -> None:
    answer = solve_toeplitz_problem(tactile(20_000, 0.25, 0.01, "exponential"))
    assert answer.trusted
    assert answer.v is not None
    assert np.log(answer.u) == pytest.approx(answer.v, rel=1e-12, abs=1e-12)


def test_a_tolerance_beyond_double_precision_is_not_claimed() -> None:
    answer = solve_toeplitz_problem(tactile(500, 0.25, 1e-6, "linear"), tolerance=1e-15)
    assert not answer.trusted
    assert "tolerance" in answer.reason


@pytest.mark.parametrize(
    ("column", "row", "eps", "lam", "key"),
    [
        (np.ones(3), np.ones(2), np.ones(3), 1.0, "column, row, eps"),
        (np.ones(3), np.zeros(3), np.ones(3), 1.0, r"row\[0\]"),
        (np.ones(3), np.ones(3), np.full(3, np.nan), 1.0, "eps"),
        (np.ones(3), np.ones(3), np.ones(3), 0.0, "lam"),
    ],
)
def test_problems_prove_themselves(
    column: np.ndarray, row: np.ndarray, eps: np.ndarray, lam: float, key: str
) -> None:
    with pytest.raises(InputError, match=key):
        ToeplitzProblem(column, row, eps, lam)
