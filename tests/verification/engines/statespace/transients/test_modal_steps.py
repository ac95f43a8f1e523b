"""Steps in the basis of the modes and in the states: against each other and closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.modal_steps import StateBoard, is_basis
from taction.verification.engines.statespace.transients.stepped import halved, simulate
from tests.support.boards import board, decompose, kernel, strain, two_pole
from tests.verification.engines.statespace.transients.test_radau import (
    Everything,
    Functions,
    OneBoard,
    Space,
)


def test_steps_by_modes_are_those_by_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    T, eps, opamp = kernel(5, 3.0), np.maximum(strain(5, 3.0), 0.05), two_pole(790e3, 12e-12)
    circuit = board(T, eps, opamp, exponential=True, bias=True, C=47e-12)
    one, analysis = LinearBoard(circuit), Transient(2e-4, 1e-6)
    modal = simulate(one, analysis, tolerance=1e-6)
    assert modal.cost.factorisations == 1
    monkeypatch.setattr(stepped, "is_basis", lambda modes: False)
    solved = simulate(one, analysis, tolerance=1e-10)
    amplitude = np.abs(solved.values - solved.values[0]).max()
    assert np.abs(modal.values - solved.values).max() < 1e-6 * amplitude
    assert np.abs(halved(modal).values - solved.values).max() < 1e-8 * amplitude


@pytest.mark.parametrize(("rate", "base", "stop"), [(1.5, 1e-3, 1.0), (40.0, 1e-4, 2.0)])
def test_an_amplifier_by_modes_against_its_closed_form(
    rate: float, base: float, stop: float
) -> None:
    """``x' = -rate x + (rate - 1) x - x^2``, from 1: a logistic curve."""

    def outputs(x: Floats) -> Floats:
        return np.asarray((rate - 1.0) * x - x**2)

    space: Any = Space(np.array([[-rate]]), np.eye(1), np.eye(1))
    modes, slopes = decompose(np.array([[-1.0]])), np.array([rate - 1.0])
    assert is_basis(modes)
    reported = Everything(Functions(1, outputs, lambda x: rate - 1.0 - 2.0 * x))
    one = OneBoard(StateBoard(space, (), slopes), modes, reported, np.ones(1), base=base)
    t = np.linspace(0.0, stop, 50)
    wanted = 1.0 / (2.0 * np.exp(t) - 1.0)  # of x' = -x - x^2
    assert one.run(stop).at(t)[:, 0] == pytest.approx(wanted, abs=1e-8)


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
