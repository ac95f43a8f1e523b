"""106-bit arithmetic against arbitrary precision."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest

from taction.verification.reference import doubledouble as dd
from taction.verification.reference.doubledouble import (
    FUNCTION_ERROR,
    PRODUCT_ERROR,
    DoubleDouble,
    ExactMatrix,
)
from taction.verification.reference.regularisers import REGULARISERS


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
