"""The Radau IIA method: its coefficients, its order, an index-1 system, and typed failures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.transients.radau import Radau, Solve, tableau


class Linear:
    """``M z' = K z``."""

    def __init__(self, M: Floats, K: Floats) -> None:
        self.M, self.K, self.size = M, K, len(M)

    def rate(self, z: Floats) -> Floats:
        return np.asarray(self.K @ z)

    def mass(self, z: NDArray[np.inexact]) -> NDArray[np.inexact]:
        return np.asarray(self.M @ z)

    def factor(self, z: Floats, shifts: Complexes) -> list[Solve]:
        def solver(shift: complex) -> Solve:
            inverse = np.linalg.inv(shift * self.M - self.K)
            return lambda r: np.asarray(inverse @ r)

        return [solver(shift) for shift in shifts.tolist()]

    def watch(self, z: Floats) -> Floats:
        return z


class Scalar(Linear):
    """``z' = f(z)`` with its derivative."""

    def __init__(self, f: Callable[[Floats], Floats], slope: Callable[[float], float]) -> None:
        super().__init__(np.eye(1), np.eye(1))
        self.f, self.slope = f, slope

    def rate(self, z: Floats) -> Floats:
        with np.errstate(over="ignore"):
            return self.f(z)

    def factor(self, z: Floats, shifts: Complexes) -> list[Solve]:
        self.K = np.array([[self.slope(float(z[0]))]])
        return super().factor(z, shifts)


def test_three_stages_are_the_published_ones() -> None:
    method = tableau(3)
    root = np.sqrt(6.0)
    assert method.c == pytest.approx([(4 - root) / 10, (4 + root) / 10, 1.0], rel=1e-14)
    third = 3.0 ** (1 / 3)
    assert method.shifts[0] == pytest.approx(3 + third**2 - third, rel=1e-12)
    estimate = np.array([-13 - 7 * root, -13 + 7 * root, -1]) / 3
    assert method.estimate == pytest.approx(estimate, rel=1e-12)


@pytest.mark.parametrize("stages", [3, 5, 7])
def test_a_method_integrates_polynomials_up_to_its_order(stages: int) -> None:
    method = tableau(stages)
    # The last stage's weights b: Z_s = h sum b_j f_j, with f = inverse Z.
    k = np.arange(1, stages + 1)
    b = np.linalg.solve((method.c[:, None] ** (k - 1)).T, 1.0 / k)
    for power in range(2 * stages - 1):
        assert b @ method.c**power == pytest.approx(1.0 / (power + 1), rel=1e-10)


SPIRAL = np.array([[-1.0, 5.0], [-5.0, -1.0]])


def spiral(relative: float, times: Floats) -> tuple[float, int]:
    radau = Radau(Linear(np.eye(2), SPIRAL), np.array([1.0, 0.0]), relative, np.ones(2), 1e-2)
    dense = radau.run(2.0)
    wanted = np.exp(-times) * np.array([np.cos(5 * times), -np.sin(5 * times)])
    return float(np.abs(dense.at(times) - wanted.T).max()), dense.steps


def test_errors_stay_below_the_tolerance_and_steps_follow_its_sixth_root() -> None:
    times = np.linspace(0.0, 2.0, 301)
    loose, tight = spiral(1e-5, times), spiral(1e-10, times)
    assert loose[0] < 1e-5
    assert tight[0] < 1e-10
    assert tight[1] / loose[1] == pytest.approx(1e5 ** (1 / 6), rel=0.35)
    assert spiral(1e-8, np.array([2.0]))[0] < 1e-12  # at the ends of steps: order nine


def test_an_algebraic_unknown_is_as_accurate_as_the_rest() -> None:
    # x' = -y with y = 2 x + z, z = 3 x: x = exp(-5 t).
    M = np.diag([1.0, 0.0, 0.0])
    K = np.array([[0.0, -1.0, 0.0], [2.0, -1.0, 1.0], [3.0, 0.0, -1.0]])
    radau = Radau(Linear(M, K), np.array([1.0, 5.0, 3.0]), 1e-10, np.ones(3), 1e-3)
    t = np.linspace(0.0, 1.0, 101)
    wanted = np.exp(-5 * t)[:, None] * [1.0, 5.0, 3.0]
    assert radau.run(1.0).at(t) == pytest.approx(wanted, abs=1e-10)


def test_stiffness_costs_nothing() -> None:
    K = np.diag([-1.0, -1e12])
    dense = Radau(Linear(np.eye(2), K), np.ones(2), 1e-8, np.ones(2), 1e-14).run(1.0)
    assert dense.steps < 100
    assert dense.at(np.array([1.0]))[0] == pytest.approx([np.exp(-1.0), 0.0], abs=1e-9)


def test_a_solution_that_blows_up_ends_at_its_limit_or_says_so() -> None:
    system = Scalar(lambda z: z**2, lambda z: 2 * z)  # 1 / (1 - t)
    dense = Radau(system, np.ones(1), 1e-8, np.ones(1), 1e-3, limit=1e6).run(2.0)
    assert dense.escaped
    assert dense.ends[-1] == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(EngineError, match=r"step fell below|range of floats"):
        Radau(system, np.ones(1), 1e-8, np.ones(1), 1e-3).run(2.0)
    with pytest.raises(EngineError, match="3 steps did not reach"):
        Radau(system, np.ones(1), 1e-8, np.ones(1), 1e-3).run(0.9, max_steps=3)


class Rounded(Linear):
    """``z' = K (z - 1)`` with a rounding of F, relative to the terms that cancel."""

    def __init__(self, K: Floats, size: float) -> None:
        super().__init__(np.eye(len(K)), K)
        self.noise, self.draw = size, np.random.default_rng(7)

    def rate(self, z: Floats) -> Floats:
        terms = np.abs(self.K) @ np.ones(z.shape)
        return np.asarray(self.K @ (z - 1.0) + self.noise * terms * self.draw.normal(size=z.shape))


@pytest.mark.parametrize("size", [1e-16, 1e-13, 1e-10, 1e-8, 1e-6])
def test_a_solution_at_rest_costs_a_handful_of_steps_however_f_is_rounded(size: float) -> None:
    K = np.array([[-1.0, 5e3], [0.0, -1e6]])
    dense = Radau(Rounded(K, size), np.ones(2), 1e-9, np.ones(2), 1e-8).run(1.0)
    assert dense.steps <= 20
    assert np.abs(dense.at(np.linspace(0.0, 1.0, 50)) - 1.0).max() <= max(dense.rounding, 1e-9)


def test_what_rounding_leaves_is_stated_and_covers_the_error() -> None:
    t = np.linspace(0.0, 1.0, 50)
    for size in (1e-13, 1e-6):
        system = Rounded(np.diag([-3.0, -1e5]), size)
        dense = Radau(system, np.zeros(2), 1e-9, np.ones(2), 1e-8).run(1.0)
        error = np.abs(dense.at(t)[:, 0] - (1.0 - np.exp(-3.0 * t))).max()
        assert error <= dense.rounding + 1e-8
        assert dense.coarse == (size > 1e-9)
    assert dense.steps < 400


def test_the_rounding_floor_does_not_hide_a_growth() -> None:
    # z = 1 + 1e-6 exp(20 t): far above rounding, far below z.
    system = Linear(np.eye(2), np.array([[20.0, -20.0], [0.0, 0.0]]))
    z = np.array([1.0 + 1e-6, 1.0])
    dense = Radau(system, z, 1e-9, np.ones(2), 1e-3).run(1.0)
    assert dense.at(np.ones(1))[0, 0] - 1.0 == pytest.approx(1e-6 * np.exp(20.0), rel=1e-2)
