"""The Radau IIA method and the integrator: coefficients, order, index 1, typed failures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.transients.radau import STAGES, Dense, tableau
from taction.verification.engines.statespace.transients.radau_integrator import Integration
from taction.verification.engines.statespace.transients.step_systems import (
    ModalBoard,
    StateBoard,
    is_basis,
)
from tests.support.boards import decompose


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

    steepest = np.zeros(1)

    def __init__(self, count: int, f: Callable[[Floats], Floats], slope: Any) -> None:
        self.count, self.f, self.slope = count, f, slope

    def outputs(self, inputs: Floats) -> Floats:
        with np.errstate(over="ignore"):
            return self.f(inputs)

    def slopes(self, inputs: Floats) -> Floats:
        return np.asarray(self.slope(inputs))


class Everything:
    """Every watched voltage is reported, in its own volts, and its distance from 0."""

    def __init__(self, devices: Any, watched: int = 1) -> None:
        self.devices, self.watched = devices, watched

    def volts(self, inputs: Floats) -> Floats:
        return np.ones(self.watched)

    def distance(self, watched: Floats) -> float:
        return float(np.abs(watched).max())


class Space:
    """The part of a state space that a board needs: watched are the inputs, then all states."""

    def __init__(self, A: Floats, inputs: Floats, E: Floats) -> None:
        n, m = E.shape
        self.A, self.B = A, np.concatenate([np.zeros((n, 2)), E], axis=1)
        self.C, self.D = inputs, np.zeros((m, 2 + m))
        self.descriptor = self
        self.devices, self.input = self, slice(None)

    def rows(self, nodes: tuple[str, ...]) -> tuple[Floats, Floats]:
        n, m = len(self.A), len(self.C)
        return (np.eye(n), np.zeros((n, 2 + m))) if nodes else (self.C[:0], self.D[:0])

    def state_of(self, unknowns: Floats) -> Floats:
        return unknowns


class OneBoard:
    """An integration from states that are watched, whose failure is an error."""

    def __init__(
        self, board: StateBoard, modes: Any, reported: Any, z: Floats, **numbers: float
    ) -> None:
        self.board, self.modes, self.reported, self.z = board, modes, reported, z
        self.numbers = {"tolerance": 1e-8, "base": 1e-3, "limit": np.inf} | numbers

    def run(self, stop: float, max_steps: int = 1_000_000, whole: Dense | None = None) -> Dense:
        steps = ModalBoard(self.board, self.modes)
        work = Integration(
            steps, self.reported, whole, steps.state(self.z), self.z, self.board.slopes,
            unit=1.0, stop=stop, **self.numbers,
        )  # fmt: skip
        work.run(max_steps)
        return work.out.checked("drawn")


def integrator(
    A: Floats, z: Floats, tolerance: float, *, first: float = 1e-2, limit: float = np.inf
) -> OneBoard:
    """``z' = A z`` with all states watched."""
    n = len(z)
    space: Any = Space(A, np.zeros((0, n)), np.zeros((n, 0)))
    board = StateBoard(space, ("all",), np.zeros(0))
    reported = Everything(Functions(0, np.exp, np.exp), n)
    return OneBoard(board, None, reported, z, tolerance=tolerance, base=first, limit=limit)


def scalar(f: Callable[[Floats], Floats], slope: Any, z: float, **more: Any) -> OneBoard:
    """``z' = f(z)`` with one amplifier, whose input is z."""
    space: Any = Space(np.zeros((1, 1)), np.eye(1), np.eye(1))
    start = np.array([z])
    board = StateBoard(space, (), np.asarray(slope(start)))
    return OneBoard(board, None, Everything(Functions(1, f, slope)), start, **more)


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


@pytest.mark.parametrize("fast", [-3e5 + 0j, -1e5 + 4e5j, -1e3 + 1e6j])
def test_a_mode_that_is_too_fast_for_both_runs_is_covered_by_its_last_coefficients(
    fast: complex,
) -> None:
    """exp(-t) beside a mode of 1e-6: half the steps do not show it."""
    ringing = np.array([[fast.real, fast.imag], [-fast.imag, fast.real]])
    A = np.block([[-np.eye(1), np.zeros((1, 2))], [np.zeros((2, 1)), ringing]])
    z = np.array([1.0, 1e-6, 0.0])
    dense = integrator(A, z, 1e-6).run(1.0)
    second = integrator(A, z, 1e-6).run(1.0, whole=dense)
    t = np.append(np.geomspace(1e-8, 1e-3, 2000), np.linspace(2e-3, 1.0, 100))
    mode = 1e-6 * np.exp(fast * t)
    wanted = np.array([np.exp(-t), mode.real, -mode.imag]).T
    errors = [np.abs(run.at(t) - wanted).max() for run in (dense, second)]
    apart = np.abs(dense.at(t) - second.at(t)).max()
    assert 1.5 * apart < errors[0]
    assert errors[1] <= second.doubt(dense) <= 6.0 * errors[1]
    assert errors[0] <= apart + second.doubt(dense)


def test_without_a_basis_of_modes_steps_work_in_the_states() -> None:
    """``x' = A x`` with a Jordan block, beside a mode that is alone: ``(1 + t) exp(-t)``."""
    A = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -30.0]])
    modes = decompose(A)
    assert not is_basis(modes)
    assert np.count_nonzero(modes.alone) == 1
    space: Any = Space(A, np.zeros((0, 3)), np.zeros((3, 0)))
    reported = Everything(Functions(0, np.exp, np.exp), 3)
    one = OneBoard(StateBoard(space, ("all",), np.zeros(0)), None, reported, np.ones(3), base=1.0)
    t = np.linspace(0.0, 3.0, 60)
    wanted = [(1.0 + t) * np.exp(-t), np.exp(-t), np.exp(-30.0 * t)]
    assert one.run(3.0).at(t) == pytest.approx(np.array(wanted).T, abs=1e-7)
