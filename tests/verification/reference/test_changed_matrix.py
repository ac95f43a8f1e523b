"""The bound on the change of the solution, against solutions with 50 digits."""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from taction.system.array_types import Floats
from taction.verification.reference.changed_matrix import change_bound
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.solve import solve
from tests.support.oracle import exact


def change(problem: Problem, changed: Floats) -> float:
    after = exact(replace(problem, T=changed))
    before = exact(problem)
    assert after is not None
    assert before is not None
    with mpmath.workdps(50):
        return float(max(abs(a - b) for a, b in zip(after, before, strict=True)))


@pytest.mark.parametrize("kind", REGULARISERS)
@pytest.mark.parametrize("size", [1e-9, 1e-4, 1e-2])
def test_the_bound_covers_the_change_and_is_not_idle(kind: str, size: float) -> None:
    random = np.random.default_rng(11)
    for lam in (1e-2, 1.0):
        for bias in {False, kind == "exponential"}:
            T = random.uniform(-0.3, 1.0, (5, 4))
            eps = T @ random.uniform(0.2, 0.8, 4) + 0.05 * random.standard_normal(5)
            problem = Problem(T, eps, lam, kind, bias)
            changed = T + size * random.standard_normal(T.shape) * (random.random(T.shape) < 0.4)
            bound, moved = change_bound(solve(problem), changed), change(problem, changed)
            assert moved <= bound <= 100 * moved


def test_the_linear_bound_by_hand() -> None:
    """T = 2, eps = 5, lam = 1: u = 2, r = 1; without the second column E^T r and E u are simple."""
    problem = Problem(np.array([[2.0, 0.1]]), np.array([5.0]), 1.0)
    before = solve(problem)
    u, r = 0.1 * before.u[1], 5.0 - 2.0 * before.u[0] - 0.1 * before.u[1]
    bound = change_bound(before, np.array([[2.0, 0.0]]))
    assert bound == pytest.approx(0.1 * abs(r) + abs(u) / 2.0, rel=1e-9)
    assert float(np.abs(before.u - [2.0, 0.0]).max()) <= bound


def test_the_bound_is_reached() -> None:
    """A new entry e beside zeros: the change is e eps / (e^2 + lam), the bound e eps / lam."""
    problem = Problem(np.array([[0.0]]), np.array([1.0]), 0.5)
    bound = change_bound(solve(problem), np.array([[1e-6]]))
    assert bound == pytest.approx(1e-6 / (1e-12 + 0.5), rel=1e-9)


def test_a_change_too_large_for_an_exponential_board_has_no_bound() -> None:
    problem = Problem(np.ones((2, 1)), np.array([3.0, 0.0]), 0.01, "exponential")
    assert change_bound(solve(problem), np.array([[1.0], [2.0]])) == math.inf


def test_an_untrusted_solution_has_no_bound() -> None:
    singular = Problem(np.ones((2, 2)), np.ones(2), 0.0)
    before = solve(singular)
    assert not before.trusted
    assert change_bound(before, np.eye(2)) == math.inf


@pytest.mark.parametrize("kind", REGULARISERS)
def test_no_slope_is_above_the_steepest(kind: str) -> None:
    v = np.linspace(-30.0, 30.0, 2001)
    steepest = REGULARISERS[kind].steepest
    largest = float(REGULARISERS[kind].slope(v).max())
    assert largest <= steepest
    assert math.isinf(steepest) or largest == pytest.approx(steepest)
