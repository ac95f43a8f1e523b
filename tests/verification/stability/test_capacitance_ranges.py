"""Stable values of C, against a closed form and against eigenvalues at many values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.file import load_scene
from taction.verification.stability.capacitance_ranges import capacitance_ranges
from taction.verification.stability.margin import with_capacitance
from taction.verification.stability.poles import poles
from tests.support.boards import lag_board, window
from tests.support.paths import SCENES


@pytest.mark.parametrize("own", [0.1, 1.0, 3.0])  # RC in tau: inside and outside the window
def test_a_window_is_found_from_both_sides(own: float) -> None:
    """K = 9: unstable between the roots of the closed form, stable on both sides."""
    low, high = window(9.0)
    board = lag_board(own, 9.0)
    found = capacitance_ranges(board)
    farads = board.scalings.capacitance / own  # RC = tau
    assert len(found.stable) == 2
    (first, below), (above, last) = found.stable
    assert (below / farads, above / farads) == pytest.approx((low, high), rel=1e-9)
    assert (first, last) == (found.low, found.high)


@pytest.mark.parametrize("scene", ["paper-breadboard", "custom-matrix", "paper-exponential"])
def test_eigenvalues_agree_at_many_values(scene: str) -> None:
    board = synthesise(load_scene(SCENES / f"{scene}.toml"))
    found = capacitance_ranges(board)
    for farads in np.geomspace(1.001 * found.low, 0.999 * found.high, 9).tolist():
        inside = any(low < farads < high for low, high in found.stable)
        assert poles(with_capacitance(board, farads)).stable == inside


def test_an_unstable_board_gives_the_same_ranges() -> None:
    board = synthesise(load_scene(SCENES / "paper-breadboard.toml"))
    edge = capacitance_ranges(board).stable[0][0]
    from_below = capacitance_ranges(with_capacitance(board, 0.5 * edge)).stable[0][0]
    assert math.isclose(edge, from_below, rel_tol=1e-9)
