"""The parts of the reference solver: regularisers, 106-bit arithmetic, factorisations."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest

from taction.verification.reference import doubledouble as dd
from taction.verification.reference import stacked_least_squares
from taction.verification.reference.doubledouble import (
    FUNCTION_ERROR,
    PRODUCT_ERROR,
    DoubleDouble,
    ExactMatrix,
)
from taction.verification.reference.regularisers import REGULARISERS, Regulariser
from taction.verification.reference.stacked_least_squares import SVD, factorise

ENTRIES = pytest.mark.parametrize("entry", REGULARISERS.values(), ids=REGULARISERS)
V = np.linspace(-6.05, 6.15, 49)  # without a break of any amplifier


@ENTRIES
def test_slope_is_the_derivative_and_potential_the_integral(entry: Regulariser) -> None:
    step = 1e-5
    slope = (entry.g(V + step) - entry.g(V - step)) / 2 / step
    assert slope == pytest.approx(entry.slope(V), rel=1e-8, abs=1e-10)
    value = (entry.potential(V + step) - entry.potential(V - step)) / 2 / step
    assert value == pytest.approx(entry.g(V), abs=1e-7, rel=1e-8)


@ENTRIES
def test_energy_has_the_inverse_as_its_derivative(entry: Regulariser) -> None:
    u, step = entry.g(np.linspace(-2.0, 2.0, 21)), 1e-6
    inside = np.isfinite(entry.inverse(u - step)) & np.isfinite(entry.inverse(u + step))
    assert inside.all() or entry.pieces is not None  # beyond a bound there is no input
    u = u[inside]
    assert len(u) > 4
    energy = [entry.energy(entry.inverse(u + side * step)) for side in (1, -1)]
    assert (energy[0] - energy[1]) / 2 / step == pytest.approx(entry.inverse(u), abs=1e-7)


@ENTRIES
@pytest.mark.parametrize("mu", [1e6, 1.0, 1e-6, 1e-12, 1e-18])
def test_v_from_q_inverts_the_coordinate(entry: Regulariser, mu: float) -> None:
    h = np.full_like(V, 0.3)
    q = np.linspace(-3.0, 3.0, len(V))
    v = entry.v_from_q(q, mu, h)
    assert np.all(np.isfinite(v))
    assert mu * v + h * entry.g(v) == pytest.approx(q, rel=1e-9, abs=1e-12)


@ENTRIES
def test_bounds_on_the_slope(entry: Regulariser) -> None:
    for width in (0.0, 0.5, 3.0):
        near = V[:, None] + np.linspace(-width, width, 41)
        largest = entry.slope(near).max(axis=1)
        assert np.all(entry.largest_slope(V, np.full_like(V, width)) >= largest * (1 - 1e-12))
    for rise in (0.0, 1e-3, 0.5):
        u = entry.g(V)
        v = V + 1e-9
        reached = entry.g(v) + rise
        inside = reached < 1.0 if entry is REGULARISERS["tanh"] else np.ones_like(V, dtype=bool)
        slope = entry.slope(entry.inverse(reached[inside]))
        assert np.all(slope <= entry.slope_bound(u[inside]) * (1 + 1e-6) + rise + 1e-6)


def wide(x: DoubleDouble) -> list[mpmath.mpf]:
    with mpmath.workdps(60):
        pairs = zip(x.hi.ravel().tolist(), x.lo.ravel().tolist(), strict=True)
        return [mpmath.mpf(a) + mpmath.mpf(b) for a, b in pairs]


def samples(rng: np.random.Generator, limit: float) -> DoubleDouble:
    sizes = 10.0 ** rng.uniform(-30, np.log10(limit), 200)
    hi = np.append(rng.choice([-1.0, 1.0], 200) * sizes, 0.0)
    return DoubleDouble.of(hi) + DoubleDouble.of(1e-17 * hi)


def worst(x: DoubleDouble, y: DoubleDouble, f: Callable[[mpmath.mpf], mpmath.mpf]) -> float:
    with mpmath.workdps(60):
        wanted = [f(a) for a in wide(x)]
        got = wide(y)
        return max(float(abs(g / w - 1)) for g, w in zip(got, wanted, strict=True) if w != 0)


@pytest.mark.parametrize(
    ("name", "function", "limit"),
    [
        ("exponential", mpmath.exp, 600.0),
        ("sinh", mpmath.sinh, 600.0),
        ("tanh", mpmath.tanh, 1e4),
        ("softplus", lambda v: mpmath.log1p(mpmath.exp(v)), 600.0),
    ],
)
def test_amplifiers_keep_every_digit(
    rng: np.random.Generator, name: str, function: Callable[[mpmath.mpf], mpmath.mpf], limit: float
) -> None:
    x = samples(rng, limit)
    assert worst(x, REGULARISERS[name].exact(x), function) < FUNCTION_ERROR


def test_exp_underflows_to_zero() -> None:
    assert dd.exp(DoubleDouble.of(np.array([-1e30, -800.0]))).hi.tolist() == [0.0, 0.0]


def test_division_and_product(rng: np.random.Generator) -> None:
    x, y = samples(rng, 1e3), samples(rng, 1e2) + dd.ONE
    with mpmath.workdps(60):
        for a, b, product, quotient in zip(wide(x), wide(y), wide(x * y), wide(x / y), strict=True):
            assert abs(product - a * b) <= FUNCTION_ERROR * abs(a * b)
            assert abs(quotient - a / b) <= FUNCTION_ERROR * abs(a / b)


def test_matrix_products_over_forty_decades(rng: np.random.Generator) -> None:
    T = rng.standard_normal((30, 40)) * 10.0 ** rng.uniform(-20, 0, (30, 40))
    exact = ExactMatrix(T)
    for product, matrix, length in ((exact.__matmul__, T, 40), (exact.transposed, T.T, 30)):
        size = 10.0 ** rng.uniform(-20, 5, length)
        x = DoubleDouble.of(size) + DoubleDouble.of(1e-17 * rng.standard_normal(length))
        with mpmath.workdps(60):
            wanted = mpmath.matrix(matrix.tolist()) * mpmath.matrix(wide(x))
            off = max(abs(a - b) for a, b in zip(wide(product(x)), wanted, strict=True))
        assert off <= PRODUCT_ERROR * np.linalg.norm(T) * np.linalg.norm(x.hi)


def test_products_with_zero() -> None:
    zero = ExactMatrix(np.zeros((2, 3)))
    assert (zero @ DoubleDouble.of(np.ones(3))).hi.tolist() == [0.0, 0.0]
    assert ExactMatrix(np.ones((2, 3))).transposed(DoubleDouble.of(np.zeros(2))).hi.sum() == 0.0


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
