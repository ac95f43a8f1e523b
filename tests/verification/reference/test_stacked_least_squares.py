"""Every factorisation solves the same equations, each within its own limits."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.reference import stacked_least_squares
from taction.verification.reference.stacked_least_squares import SVD, factorise


def wanted(T: np.ndarray, D: np.ndarray, mu: float, f1: np.ndarray, f2: np.ndarray) -> np.ndarray:
    A = T * D
    return np.linalg.solve(A.T @ A + mu * np.eye(len(D)), A.T @ f1 + f2)


@pytest.mark.parametrize("mu", [1e-3, 1e-13])
def test_cholesky_and_qr(rng: np.random.Generator, mu: float) -> None:
    T, D = rng.standard_normal((8, 5)), rng.random(5) + 0.5
    f1, f2 = rng.standard_normal(8), rng.standard_normal(5)
    y = factorise(T, T.T @ T, D, mu).solve(f1, f2)
    assert y == pytest.approx(wanted(T, D, mu, f1, f2), rel=1e-11)


def test_qr_keeps_digits_that_normal_equations_lose(rng: np.random.Generator) -> None:
    U, V = (np.linalg.qr(rng.standard_normal((6, 6)))[0] for _ in range(2))
    sigma = np.logspace(0, -7, 6)
    T, y = (U * sigma) @ V.T, rng.standard_normal(6)
    mu = 1e-24
    solved = factorise(T, T.T @ T, np.ones(6), mu).solve(T @ y, np.zeros(6))
    assert solved == pytest.approx(y, abs=1e-7)
    gram = T.T @ T
    assert np.max(np.abs(np.linalg.solve(gram, T.T @ (T @ y)) - y)) > 1e-4


def test_channels_without_coupling_are_left_out(rng: np.random.Generator) -> None:
    T = rng.standard_normal((6, 10))
    D = np.where(np.arange(10) % 3 == 0, 1.0, 1e-15)
    f1, f2 = rng.standard_normal(6), rng.standard_normal(10)
    factor = factorise(T, T.T @ T, D, 1e-3)
    assert isinstance(factor, stacked_least_squares._Partial)
    assert factor.solve(f1, f2) == pytest.approx(wanted(T, D, 1e-3, f1, f2), rel=1e-9)
    nothing = factorise(T, T.T @ T, np.zeros(10), 1e-3).solve(f1, f2)
    assert nothing == pytest.approx(f2 / 1e-3, rel=1e-15)


@pytest.mark.parametrize("shape", [(7, 4), (4, 7)])
def test_singular_values(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    T, f1, f2 = rng.standard_normal(shape), rng.standard_normal(shape[0]), rng.random(shape[1])
    svd = SVD(T, 0.1)
    assert svd.solve(f1, f2) == pytest.approx(wanted(T, np.ones(shape[1]), 0.1, f1, f2), rel=1e-11)
    stack = np.vstack([T, np.sqrt(0.1) * np.eye(shape[1])])
    sigma = np.linalg.svd(stack, compute_uv=False)
    assert svd.least == pytest.approx(sigma[-1], rel=1e-12)
    assert svd.condition == pytest.approx(sigma[0] / sigma[-1], rel=1e-12)


def test_singular_values_of_what_has_no_rank() -> None:
    assert SVD(np.ones((3, 3)), 0.0).least == 0.0
    assert SVD(np.ones((2, 3)), 0.0).condition == float("inf")
