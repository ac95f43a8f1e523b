"""The stability boundary over two axes, against values that are known from elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import parse_axes
from taction.netlist_gen.scene.loading import load_scene
from taction.verification.studies.sweep.boundary import TOLERANCE, Boundary, solve_boundary
from taction.verification.studies.sweep.plan import Plan
from tests.support.paths import CASES, SCENES


def boundary(path: object, *over: str, **options: float) -> Boundary:
    scene = load_scene(str(path))
    return solve_boundary(Plan(scene, parse_axes(scene, list(over)), ("statespace",)), **options)


def test_an_unstable_range_between_two_points_of_the_grid_is_found() -> None:
    """The ends of the range are those of the poles of the deck's text (shared cases)."""
    own = load_scene(CASES / "margin-window.toml").design.gain
    over = ("C=1nF:1.5nF:2", f"gain={own}:{1.0001 * own}:2")
    found = boundary(CASES / "margin-window.toml", *over)
    ends = sorted(c for c, gain in found.points if gain == own)
    assert ends == pytest.approx([1.1153e-9, 1.2547e-9], rel=2 * TOLERANCE)


def test_the_paper_s_board_oscillates_with_the_next_smaller_capacitors() -> None:
    """It was fitted to oscillate below 9.0 pF (design notes), on every line close to its gain."""
    found = boundary(SCENES / "paper-breadboard.toml", "C=8pF:12pF:3", "gain=6M:6.5M:3")
    across = [c for c, gain in found.points if gain in (6e6, 6.5e6) and 8e-12 < c < 12e-12]
    assert all(8.5e-12 < c < 9.6e-12 for c in across)
    assert len(across) >= 2
    lengths = [np.hypot(np.log(a[0] / b[0]), np.log(a[1] / b[1])) for a, b in found.segments]
    assert lengths
    assert max(lengths) < 0.3


def test_nothing_lies_between_two_names() -> None:
    found = boundary(
        SCENES / "paper-breadboard.toml", "C=1pF:100pF:5", "design.opamp.base=ideal,ua741"
    )
    assert found.segments == ()
    assert {place for _, place in found.points} <= {0.0, 1.0}
    assert found.points


def test_a_boundary_that_would_take_too_long_is_not_solved() -> None:
    found = boundary(SCENES / "paper-breadboard.toml", "C=1pF:1nF:5", "gain=1M:9M:5", seconds=0.0)
    assert found.points == ()
    assert "would take" in found.unsolved
