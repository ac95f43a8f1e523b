"""The ways of several boards' channels in common arrays, against each board's own solution."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.readings.course import Course, Courses
from tests.support.boards import lags, paper_board, single_mode

TIMES = np.array([0.0, 1e-9, 2e-7, 1e-6, 5e-6, 4e-5])
BOARDS = {
    "few channels": [lags(3, 1e-6), single_mode(1e-3), lags(1, 2e-6), lags(2, 1e-7)],
    "many channels": [paper_board(), paper_board(20e-12)],
}


def courses(circuits: list[Circuit]) -> list[Course]:
    """Return the ways of boards to where they come to rest, which is 1 mV off the target."""
    found = []
    for circuit in circuits:
        solution = exact_solution(LinearBoard(circuit))
        signs = np.where(np.arange(len(solution.final)) % 2, 1.0, -1.0)
        found.append(Course(solution, signs, solution.final * signs - 1e-3, 1e-9, 1e-6))
    return found


@pytest.mark.parametrize("kind", BOARDS)
def test_errors_slopes_and_bounds_are_those_of_each_solution(kind: str) -> None:
    each = courses(BOARDS[kind])
    board = np.repeat(np.arange(len(each)), len(TIMES))
    together, times = Courses(each), np.tile(TIMES, len(each))
    found = *together.evaluate(times, board), together.bounds(times, board)
    for k, course in enumerate(each):
        solution, signs = course.solution, course.signs
        errors, slopes, bounds = (column[board == k] for column in found)
        scale = float(np.abs(solution.final).max())
        rate = float(solution.flow.speeds.max())
        assert errors == pytest.approx(
            solution.at(TIMES) * signs - course.target, rel=1e-9, abs=1e-12 * scale
        )
        wanted = solution.derivative(TIMES) * signs
        assert slopes == pytest.approx(wanted, rel=1e-9, abs=1e-12 * scale * rate)
        assert bounds == pytest.approx(solution.bounds(TIMES) + 1e-9, rel=1e-9)


@pytest.mark.parametrize("kind", BOARDS)
def test_no_board_leaves_its_bounds(kind: str) -> None:
    """Between two instants, and after one, the solution stays below what is said of it."""
    each = courses(BOARDS[kind])
    together, every = Courses(each), np.arange(len(each))
    begin, end = np.full((2, len(each)), [[3e-7], [9e-7]])
    left = together.remainder(begin, every)
    heights = together.envelopes(begin, end, every)
    room, _ = together.room(begin, end - begin, every)
    between, later = np.linspace(3e-7, 9e-7, 200), np.geomspace(3e-7, 1e-2, 500)

    def errors(course: Course, times: Floats) -> Floats:
        return course.solution.at(times) * course.signs - course.target

    for k, course in enumerate(each):
        slack = 1e-9 * float(np.abs(course.solution.final).max())
        assert np.all(np.abs(errors(course, later) - course.ends) <= left[k] + slack)
        inside = errors(course, between)
        assert np.all(inside.max(axis=0) <= heights[k, 0] + slack)
        assert np.all((-inside).max(axis=0) <= heights[k, 1] + slack)
        first, last = errors(course, between[[0, -1]])
        rise, fall = course.solution.derivative(between[[0, -1]]) * course.signs * 6e-7
        x = np.linspace(0.0, 1.0, 200)[:, None]
        cubic = (
            first * (1 - 3 * x**2 + 2 * x**3)
            + rise * (x - 2 * x**2 + x**3)
            + last * (3 * x**2 - 2 * x**3)
            + fall * (x**3 - x**2)
        )
        assert np.all(np.abs(inside - cubic) <= room[k] + slack)


def test_a_single_lag_is_followed_in_quarters_of_its_time_constant() -> None:
    (course,) = courses([lags(1, 1e-6)])
    times, _ = Courses([course]).first_grids()
    until = 1e-6 * np.log(1.0 / course.detail)  # from 1 V on it falls below the detail there
    assert times[-1] == pytest.approx(until, rel=1e-3)
    allowed = np.maximum(0.25e-6, times[1:] / 32)  # the later ones in geometric progression
    assert np.all(np.diff(times) <= allowed * (1 + 1e-9))
    rate = Courses([course]).rate(np.array([0.0, 1.0]), np.array([0, 0]))
    assert rate == pytest.approx([1e6, 0.0], rel=1e-6)
