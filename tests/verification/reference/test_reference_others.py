"""The reference solver against general solvers that know nothing of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from tests.support.oracle import kernel

Y = np.linspace(-3.0, 3.0, 25)
T = kernel(Y, Y, 1.0)
NOISE = 0.05 * np.random.default_rng(5).standard_normal(25)
BASE = Problem(T, T @ np.sqrt(np.maximum(1.0 - Y * Y, 0.0)) + NOISE, 1.0)


@pytest.mark.parametrize("lam", [10.0, 0.1])
@pytest.mark.parametrize("bias", [False, True])
def test_scipy_trust_exact(lam: float, bias: bool) -> None:
    """In v = log u, where the problem is free of constraints."""
    from scipy.optimize import minimize

    problem = replace(BASE, lam=lam, regulariser="exponential", bias=bias)
    beta, eps = float(bias), problem.eps

    def value(v: np.ndarray) -> float:
        u, miss = np.exp(v), T @ np.exp(v) - eps
        return float(miss @ miss + lam * np.sum(u * v - u + beta * u))

    def gradient(v: np.ndarray) -> np.ndarray:
        u = np.exp(v)
        return np.asarray(u * (2.0 * T.T @ (T @ u - eps) + lam * (v + beta)))

    def hessian(v: np.ndarray) -> np.ndarray:
        u = np.exp(v)
        inner = 2.0 * T.T @ T * np.outer(u, u)
        return np.asarray(inner + np.diag(gradient(v) + lam * u))

    run = minimize(
        value, np.zeros(25), jac=gradient, hess=hessian, method="trust-exact",
        options={"gtol": 1e-10, "maxiter": 2000},
    )  # fmt: skip
    answer = solve(problem)
    assert np.exp(run.x) == pytest.approx(answer.u, abs=1e-7)
    assert run.fun == pytest.approx(answer.objective, rel=1e-12)


def test_scipy_nonnegative_least_squares_is_the_limit() -> None:
    from scipy.optimize import nnls

    answer = solve(replace(BASE, lam=1e-12, regulariser="exponential"))
    assert answer.trusted
    assert answer.u == pytest.approx(nnls(T, BASE.eps)[0], abs=1e-6)


def test_scipy_bounded_least_squares_is_the_limit_of_tanh() -> None:
    from scipy.optimize import lsq_linear

    answer = solve(replace(BASE, lam=1e-12, regulariser="tanh"))
    assert answer.trusted
    bounded = lsq_linear(T, BASE.eps, (-1.0, 1.0), method="bvls", tol=1e-14)
    assert answer.u == pytest.approx(bounded.x, abs=1e-6)


@pytest.mark.parametrize("lam", [10.0, 0.01, 1e-6])
def test_cvxpy_with_clarabel(lam: float) -> None:
    cp = pytest.importorskip("cvxpy")
    u = cp.Variable(25)
    loss = cp.sum_squares(T @ u - BASE.eps)
    task = cp.Problem(cp.Minimize(loss - lam * cp.sum(cp.entr(u))))
    task.solve(solver=cp.CLARABEL)
    answer = solve(replace(BASE, lam=lam, regulariser="exponential", bias=True))
    assert u.value == pytest.approx(answer.u, abs=1e-4)
    theirs = np.maximum(u.value, 1e-300)  # it may return entries a hair below zero
    miss = T @ theirs - BASE.eps
    objective = float(miss @ miss + lam * np.sum(theirs * np.log(theirs)))
    assert objective >= answer.objective - 1e-14
    assert objective == pytest.approx(answer.objective, rel=1e-6, abs=1e-9)
