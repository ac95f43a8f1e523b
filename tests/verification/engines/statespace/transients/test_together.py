"""Boards that are integrated together: each as if it were alone, and against closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.modal_steps import (
    ModalBoards,
    StateBoard,
    is_basis,
)
from taction.verification.engines.statespace.transients.stepped import (
    Task,
    halved,
    simulate,
    simulate_together,
)
from tests.support.boards import board, kernel, strain, two_pole
from tests.support.decomposing import decompose
from tests.verification.engines.statespace.transients.test_radau import (
    Everything,
    Functions,
    Space,
    begin,
)

STOP = 2e-4  # s


def exponential(channels: int, capacitance: float) -> Circuit:
    T, eps = kernel(channels, 3.0), np.maximum(strain(channels, 3.0), 0.05)
    opamp = two_pole(790e3, 12e-12)
    return board(T, eps, opamp, exponential=True, bias=True, C=capacitance)


def tasks() -> list[Task]:
    """Boards of two sizes that take different numbers of steps, and one without an equilibrium."""
    found = [exponential(3, 20e-12), exponential(3, 2e-9), exponential(5, 47e-12)]
    floating = replace(found[0], resistors=())
    boards = [LinearBoard(circuit) for circuit in (*found, floating)]
    return [Task(each, Transient(STOP, 1e-6), tolerance=1e-6) for each in boards]


def test_a_board_gets_the_same_record_with_others_as_alone() -> None:
    several = simulate_together(tasks(), halves=True)
    for task, found in zip(tasks()[:3], several, strict=False):
        alone = simulate(task.board, task.analysis, tolerance=task.tolerance)
        assert isinstance(found, Waveforms)
        assert np.array_equal(found.values, alone.values)
        assert found.cost.points == alone.cost.points
        assert np.array_equal(halved(found).values, halved(alone).values)
    points = [found.cost.points for found in several if isinstance(found, Waveforms)]
    assert points[0] != points[1]  # of one kind, each with steps of its own
    assert isinstance(several[3], EngineError)


def test_steps_by_modes_are_those_by_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    task = tasks()[2]
    modal = simulate(task.board, task.analysis, tolerance=1e-6)
    assert modal.cost.factorisations == 1
    monkeypatch.setattr(stepped, "is_basis", lambda modes: False)
    solved = simulate(task.board, task.analysis, tolerance=1e-10)
    amplitude = np.abs(solved.values - solved.values[0]).max()
    assert np.abs(modal.values - solved.values).max() < 1e-6 * amplitude
    assert np.abs(halved(modal).values - solved.values).max() < 1e-8 * amplitude


def test_amplifiers_of_several_boards_against_their_closed_forms() -> None:
    """``x' = -rate x + (rate - 1) x - x^2``, from 1: a logistic curve, for several rates."""

    class Logistic(Functions):
        def __init__(self, rate: float) -> None:
            super().__init__(1, np.exp, np.exp)
            self.rates = np.array([[[rate]]])

        def outputs(self, inputs: Floats) -> Floats:
            return np.asarray((self.rates - 1.0) * inputs - inputs**2)

        def slopes_along(self, inputs: Floats, segments: Any) -> Floats:
            return np.asarray(self.rates[:, :, 0] - 1.0 - 2.0 * inputs)

    works, stops = [], (1.0, 3.0, 2.0)
    for rate, base, stop in zip((1.5, 3.0, 40.0), (1e-3, 1e-2, 1e-4), stops, strict=True):
        space: Any = Space(np.array([[-rate]]), np.eye(1), np.eye(1))
        modes, slopes = decompose(np.array([[-1.0]])), np.array([rate - 1.0])
        assert is_basis(modes)
        modal = ModalBoards(StateBoard(space, (), slopes), modes)
        reported, start = Everything(Logistic(rate)), np.ones((1, 1))
        works.append(begin(modal, reported, start, slopes[None], 1e-8, base, np.inf, stop))
    works[0].join(works).run()
    for work, stop in zip(works, stops, strict=True):
        t = np.linspace(0.0, stop, 50)
        wanted = 1.0 / (2.0 * np.exp(t) - 1.0)  # of x' = -x - x^2
        assert work.out[0].checked("drawn").at(t)[:, 0] == pytest.approx(wanted, abs=1e-8)


def test_without_a_basis_of_modes_steps_work_in_the_states() -> None:
    """``x' = A x`` with a Jordan block, beside a mode that is alone: ``(1 + t) exp(-t)``."""
    A = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -30.0]])
    modes = decompose(A)
    assert not is_basis(modes)
    assert np.count_nonzero(modes.alone) == 1
    space: Any = Space(A, np.zeros((0, 3)), np.zeros((3, 0)))
    modal = ModalBoards(StateBoard(space, ("all",), np.zeros(0)), None)
    reported = Everything(Functions(0, np.exp, np.exp), 3)
    work = begin(modal, reported, np.ones((1, 3)), np.zeros((1, 0)), 1e-8, 1.0, np.inf, 3.0)
    work.run()
    t = np.linspace(0.0, 3.0, 60)
    wanted = [(1.0 + t) * np.exp(-t), np.exp(-t), np.exp(-30.0 * t)]
    assert work.out[0].checked("drawn").at(t) == pytest.approx(np.array(wanted).T, abs=1e-7)
