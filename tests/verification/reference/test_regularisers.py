"""The parts of the reference solver: regularisers, exact sums, factorisations."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest

from taction.verification.reference.exact_products import PRODUCT_ERROR, ExactMatrix, Pair
from taction.verification.reference.regularisers import REGULARISERS, Regulariser
from taction.verification.reference.smooth import FUNCTION_ERROR
from taction.verification.reference.stacked_least_squares import SVD, factorise

ENTRIES = pytest.mark.parametrize("entry", REGULARISERS.values(), ids=REGULARISERS)
NONLINEAR = ("exponential", "sinh", "softplus", "tanh")
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


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("exponential", mpmath.exp),
        ("sinh", mpmath.sinh),
        ("tanh", mpmath.tanh),
        ("softplus", lambda v: mpmath.log1p(mpmath.exp(v))),
    ],
)
def test_amplifiers_are_within_their_stated_error(
    rng: np.random.Generator, name: str, function: Callable[[mpmath.mpf], mpmath.mpf]
) -> None:
    v = rng.choice([-1.0, 1.0], 300) * 10.0 ** rng.uniform(-30, np.log10(600.0), 300)
    with mpmath.workdps(40):
        exact = [function(mpmath.mpf(x)) for x in v.tolist()]
        pairs = zip(REGULARISERS[name].g(v).tolist(), exact, strict=True)
        assert max(float(abs(g / w - 1)) for g, w in pairs) < FUNCTION_ERROR


@pytest.mark.parametrize("entry", [REGULARISERS[k] for k in NONLINEAR], ids=NONLINEAR)
def test_no_slope_changes_by_more_than_twice_itself(entry: Regulariser) -> None:
    step = 1e-5
    change = np.abs(entry.slope(V + step) - entry.slope(V - step)) / 2 / step
    assert np.all(change <= 2.0 * entry.slope(V) * (1.0 + 1e-6))


def test_products_over_forty_decades_that_cancel(rng: np.random.Generator) -> None:
    A = rng.standard_normal((30, 40)) * 10.0 ** rng.uniform(-20, 0, (30, 40))
    exact = ExactMatrix(A)
    for product, matrix in ((exact, A), (exact.transposed, A.T)):
        size = 10.0 ** rng.uniform(-20, 5, matrix.shape[1])
        x = Pair.of(size) + 1e-17 * rng.standard_normal(len(size))
        near = -(matrix @ x.hi)
        error = PRODUCT_ERROR * np.linalg.norm(A) * np.linalg.norm(size)
        with mpmath.workdps(60):
            pairs = zip(x.hi.tolist(), x.lo.tolist(), strict=True)
            vector = mpmath.matrix([mpmath.mpf(a) + mpmath.mpf(b) for a, b in pairs])
            wanted = mpmath.matrix(matrix.tolist()) * vector + mpmath.matrix(near.tolist())
            for got, value in zip(product.sums(x, near).tolist(), wanted, strict=True):
                assert abs(got - value) <= error + 2.0**-53 * abs(value)


def test_pairs_keep_what_doubles_drop(rng: np.random.Generator) -> None:
    x, total = Pair.of(np.array([1.0])), mpmath.mpf(1)
    with mpmath.workdps(60):
        for step in (10.0 ** rng.uniform(-25, 0, 50)).tolist():
            x, total = x + np.array([step]), total + mpmath.mpf(step)
        held = mpmath.mpf(x.hi[0]) + mpmath.mpf(x.lo[0])
        assert abs(held - total) <= 2.0**-98 * total
        scaled = sum(mpmath.mpf(each[0]) for each in x.times(1.0 / 3.0))
        assert abs(scaled - held * mpmath.mpf(1.0 / 3.0)) <= 2.0**-104


def wanted(T: np.ndarray, D: np.ndarray, mu: float, f1: np.ndarray, f2: np.ndarray) -> np.ndarray:
    A = T * D
    return np.linalg.solve(A.T @ A + mu * np.eye(len(D)), A.T @ f1 + f2)


@pytest.mark.parametrize("mu", [1e-3, 1e-13])
def test_cholesky_and_qr(rng: np.random.Generator, mu: float) -> None:
    T, D = rng.standard_normal((8, 5)), rng.random(5) + 0.5
    f1, f2 = rng.standard_normal(8), rng.standard_normal(5)
    y = factorise(T, T.T @ T, D, mu)(f1, f2)
    assert y == pytest.approx(wanted(T, D, mu, f1, f2), rel=1e-11)


def test_qr_keeps_digits_that_normal_equations_lose(rng: np.random.Generator) -> None:
    U, V = (np.linalg.qr(rng.standard_normal((6, 6)))[0] for _ in range(2))
    sigma = np.logspace(0, -7, 6)
    T, y = (U * sigma) @ V.T, rng.standard_normal(6)
    mu = 1e-24
    solved = factorise(T, T.T @ T, np.ones(6), mu)(T @ y, np.zeros(6))
    assert solved == pytest.approx(y, abs=1e-7)
    gram = T.T @ T
    assert np.max(np.abs(np.linalg.solve(gram, T.T @ (T @ y)) - y)) > 1e-4


def test_channels_without_coupling(rng: np.random.Generator) -> None:
    T = rng.standard_normal((6, 10))
    D = np.where(np.arange(10) % 3 == 0, 1.0, 1e-15)
    f1, f2 = rng.standard_normal(6), rng.standard_normal(10)
    factor = factorise(T, T.T @ T, D, 1e-3)
    assert factor(f1, f2) == pytest.approx(wanted(T, D, 1e-3, f1, f2), rel=1e-9)
    nothing = factorise(T, T.T @ T, np.zeros(10), 1e-3)(f1, f2)
    assert nothing == pytest.approx(f2 / 1e-3, rel=1e-14)


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
