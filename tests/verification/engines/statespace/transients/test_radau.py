"""The Radau IIA method and the integrator: coefficients, order, index 1, typed failures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from taction.system.array_types import Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.transients.dense import Dense
from taction.verification.engines.statespace.transients.integrator import (
    Present,
    RadauIntegrator,
)
from taction.verification.engines.statespace.transients.radau import STAGES, TABLE, tableau
from taction.verification.engines.statespace.transients.steps import SIGMA


def test_three_stages_are_the_published_ones() -> None:
    method = tableau(3)
    root = np.sqrt(6.0)
    assert method.c == pytest.approx([(4 - root) / 10, (4 + root) / 10, 1.0], rel=1e-14)
    third = 3.0 ** (1 / 3)
    assert method.shifts[0] == pytest.approx(3 + third**2 - third, rel=1e-12)


@pytest.mark.parametrize("stages", [3, 9])
def test_the_coefficients_are_those_of_the_polynomial_through_start_and_stages(stages: int) -> None:
    method = tableau(stages)
    theta = np.append(0.0, method.c)
    assert method.legendre @ (2.0 * theta - 1.0) == pytest.approx([0.0, 1.0] + [0.0] * (stages - 1))
    square = method.legendre @ (2.0 * theta - 1.0) ** 2  # 1/3 P0 + 2/3 P2
    assert square[:3] == pytest.approx([1 / 3, 0.0, 2 / 3])


@pytest.mark.parametrize("stages", [3, 5, 9])
def test_a_method_integrates_polynomials_up_to_its_order(stages: int) -> None:
    method = tableau(stages)
    # The last stage's weights b: Z_s = h sum b_j f_j, with f = inverse Z.
    inverse = (method.right @ (method.shifts[:, None] * method.left)).real
    b = np.linalg.inv(inverse)[-1]
    for power in range(2 * stages - 1):
        assert b @ method.c**power == pytest.approx(1.0 / (power + 1), rel=1e-9)


class Functions:
    """``a = f(v)`` of m amplifiers of one kind."""

    def __init__(self, count: int, f: Callable[[Floats], Floats], slope: Any) -> None:
        self.count, self.f, self.slope, self.pieces = count, f, slope, None

    def outputs(self, inputs: Floats) -> Floats:
        with np.errstate(over="ignore"):
            return self.f(inputs)

    def slopes(self, inputs: Floats) -> Floats:
        return np.asarray(self.slope(inputs))

    def along(self, inputs: Floats, segments: Ints) -> Floats:
        return self.outputs(inputs)


@dataclass
class Everything:
    """Every watched voltage is reported, in its own volts, and its distance from 0."""

    amplifiers: Any

    def volts(self, inputs: Floats) -> Floats:
        return np.ones((len(inputs), self.watched))

    def distance(self, watched: Floats) -> Floats:
        return np.asarray(np.abs(watched).max(axis=1))

    def part(self, rows: Ints) -> Everything:
        return self

    watched: int = 1


class Solved:
    """One board ``x' = A x + E a`` with inputs ``v = G x``, watched before all of x if asked."""

    factorisations = 0

    def __init__(self, A: Floats, G: Floats, E: Floats, *, watched: bool) -> None:
        self.A, self.G, self.E, self.m = A, G, E, E.shape[1]
        self.rows = np.concatenate([G, np.eye(len(A))]) if watched else G

    def part(self, rows: Ints) -> Solved:
        return self

    def rate(self, state: Floats, inputs: Floats, outputs: Floats) -> Floats:
        return np.asarray((self.A @ state[0] + self.E @ outputs[0])[None])

    def step(self, length: Floats, slopes: Floats) -> SolvedStep:
        closed = self.A + (self.E * slopes[0]) @ self.G
        return SolvedStep(
            self, [s / length[0] * np.eye(len(closed)) - closed for s in TABLE.shifts]
        )


@dataclass
class SolvedStep:
    """Its steps, by solves with the whole matrices."""

    board: Solved
    matrices: list[Any]

    def _solved(self, right: Any) -> Any:
        return np.array(list(map(np.linalg.solve, self.matrices, right)))

    def _stages(self, x: Any) -> Floats:
        return np.asarray((TABLE.right @ (x @ self.board.rows.T)).real.T[None])

    def free(self, rate: Floats) -> tuple[Floats, Any]:
        x = self._solved(SIGMA[:, None] * rate)
        return self._stages(x)[:, : self.board.m], [x]

    def response(self, remainder: Floats, parts: Any) -> Floats:
        parts[1:] = [self._solved((TABLE.left @ remainder[0].T) @ self.board.E.T)]
        return self._stages(parts[1])[:, : self.board.m]

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Any, Floats]:
        x = sum(parts)
        return x, self._stages(x)

    def moved(self, parts: Any, weights: Any) -> Floats:
        return np.asarray((weights[0] @ parts).real[None])


class OneBoard:
    """The integrator of one board, whose failure is an error."""

    def __init__(
        self, board: Solved, reported: Everything, z: Floats, slopes: Floats, numbers: Floats
    ) -> None:
        columns = numbers[:, None]  # tolerance, unit, base, limit
        present = Present(z[None], z[None], slopes[None], *columns)
        self.work = RadauIntegrator(board, reported, present)

    def run(self, stop: float, max_steps: int = 1_000_000) -> Dense:
        return self.work.run(np.array([stop]), max_steps)[0].checked("drawn")

    def repeat(self, levels: list[int]) -> Dense:
        return self.work.repeat([levels])[0].checked("drawn")


def integrator(
    A: Floats, z: Floats, tolerance: float, *, first: float = 1e-2, limit: float = np.inf
) -> OneBoard:
    """``z' = A z`` with all states watched."""
    n = len(z)
    board = Solved(A, np.zeros((0, n)), np.zeros((n, 0)), watched=True)
    none = Functions(0, np.exp, np.exp)
    reported = Everything(none, n)
    return OneBoard(board, reported, z, np.zeros(0), np.array([tolerance, 1.0, first, limit]))


def scalar(f: Callable[[Floats], Floats], slope: Any, z: float, **more: Any) -> OneBoard:
    """``z' = f(z)`` with one amplifier, whose input is z."""
    board = Solved(np.zeros((1, 1)), np.eye(1), np.eye(1), watched=False)
    slopes, start = np.asarray(slope(np.array([z]))), np.array([z])
    reported = Everything(Functions(1, f, slope), 1)
    given = {"tolerance": 1e-8, "unit": 1.0, "base": 1e-3, "limit": np.inf} | more
    return OneBoard(board, reported, start, slopes, np.array(list(given.values())))


SPIRAL = np.array([[-1.0, 5.0], [-5.0, -1.0]])


def spiral(tolerance: float, times: Floats) -> tuple[float, Dense]:
    dense = integrator(SPIRAL, np.array([1.0, 0.0]), tolerance).run(2.0)
    wanted = np.exp(-times) * np.array([np.cos(5 * times), -np.sin(5 * times)])
    return float(np.abs(dense.at(times) - wanted.T).max()), dense


def test_errors_stay_below_the_tolerance_and_steps_follow_its_tenth_root() -> None:
    times = np.linspace(0.0, 2.0, 301)
    (loose, few), (tight, many) = spiral(1e-4, times), spiral(1e-10, times)
    assert loose < 1e-4
    assert tight < 1e-10
    # Lengths are powers of two, so the ratio may be off by that much.
    assert 0.5 <= many.steps / few.steps / 1e6 ** (1 / (STAGES + 1)) <= 2.0
    assert spiral(1e-6, np.array([2.0]))[0] < 1e-10  # at the ends of steps: order seventeen


def test_half_the_steps_err_by_the_order_of_the_dense_output() -> None:
    times = np.linspace(0.0, 2.0, 301)
    _, dense = spiral(1e-5, times)
    second = integrator(SPIRAL, np.array([1.0, 0.0]), 1e-5)
    halved = second.repeat([level - 1 for level in dense.levels for _ in range(2)])
    wanted = (np.exp(-times) * np.array([np.cos(5 * times), -np.sin(5 * times)])).T
    errors = [np.abs(run.at(times) - wanted).max() for run in (dense, halved)]
    assert errors[1] < errors[0] / 2.0 ** (STAGES - 1)


def test_stiffness_costs_nothing() -> None:
    dense = integrator(np.diag([-1.0, -1e12]), np.ones(2), 1e-8, first=1e-14).run(1.0)
    assert dense.steps < 100
    assert dense.at(np.array([1.0]))[0] == pytest.approx([np.exp(-1.0), 0.0], abs=1e-9)


@pytest.mark.parametrize("first", [1e-6, 1e-2, 1.0])
def test_an_amplifier_against_its_closed_form(first: float) -> None:
    dense = scalar(lambda z: -(z**2), lambda z: -2 * z, 1.0, base=first).run(3.0)
    t = np.linspace(0.0, 3.0, 100)
    assert dense.at(t)[:, 0] == pytest.approx(1.0 / (1.0 + t), abs=1e-8)


def test_a_solution_that_blows_up_ends_at_its_limit_or_says_so() -> None:
    def square(**more: Any) -> OneBoard:  # 1 / (1 - t)
        return scalar(lambda z: z**2, lambda z: 2 * z, 1.0, **more)

    dense = square(limit=1e6).run(2.0)
    assert dense.escaped
    assert dense.ends[-1] == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(EngineError, match=r"no solution after (1\.0|0\.99999)"):
        square().run(2.0)
    with pytest.raises(EngineError, match="3 steps did not reach"):
        square().run(0.9, max_steps=3)


@pytest.mark.parametrize("size", [1.0, 1e4, 1e8])
def test_what_rounding_leaves_is_stated_and_covers_the_error(size: float) -> None:
    """Two stiff states that nearly cancel in the watched slow one: z' = size (x - y) - 3 z."""
    A = np.array([[-3.0, size, -size], [0.0, -1e5, 0.0], [0.0, 0.0, -1e5]])
    z = np.array([1.0, size, size])
    run = integrator(A, z, 1e-9, first=1e-8)
    dense = run.run(1.0)
    t = np.linspace(0.01, 1.0, 50)
    error = np.abs(dense.at(t)[:, 0] - np.exp(-3.0 * t)).max()
    assert error <= dense.rounding + 1e-8
    assert dense.steps < 400


def test_the_rounding_floor_does_not_hide_a_growth() -> None:
    # z = 1 + 1e-6 exp(20 t): far above rounding, far below z.
    A = np.array([[20.0, -20.0], [0.0, 0.0]])
    dense = integrator(A, np.array([1.0 + 1e-6, 1.0]), 1e-9, first=1e-3).run(1.0)
    assert dense.at(np.ones(1))[0, 0] - 1.0 == pytest.approx(1e-6 * np.exp(20.0), rel=1e-2)


@pytest.mark.parametrize("fast", [-3e5 + 0j, -1e5 + 4e5j, -1e3 + 1e6j])
def test_a_mode_that_is_too_fast_for_both_runs_is_covered_by_its_last_coefficients(
    fast: complex,
) -> None:
    """exp(-t) beside a mode of 1e-6: half the steps do not show it."""
    ringing = np.array([[fast.real, fast.imag], [-fast.imag, fast.real]])
    A = np.block([[-np.eye(1), np.zeros((1, 2))], [np.zeros((2, 1)), ringing]])
    z = np.array([1.0, 1e-6, 0.0])
    dense = integrator(A, z, 1e-6).run(1.0)
    second = integrator(A, z, 1e-6).repeat([level - 1 for level in dense.levels for _ in "ab"])
    t = np.append(np.geomspace(1e-8, 1e-3, 2000), np.linspace(2e-3, 1.0, 100))
    mode = 1e-6 * np.exp(fast * t)
    wanted = np.array([np.exp(-t), mode.real, -mode.imag]).T
    errors = [np.abs(run.at(t) - wanted).max() for run in (dense, second)]
    apart = np.abs(dense.at(t) - second.at(t)).max()
    assert 1.5 * apart < errors[0]
    assert errors[1] <= second.unresolved(dense) <= 6.0 * errors[1]
    assert errors[0] <= apart + second.unresolved(dense)
