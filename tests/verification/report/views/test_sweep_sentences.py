"""Sentences of a sweep say what its numbers say: of stability, of small and of missing values."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.report.renderers.figures import wrapped
from taction.verification.report.views.sweep import SHOWN, _worth
from taction.verification.report.views.sweep_maps import Plane
from tests.support.sweeping import grid_plan

LISTS = ("opamp.base=ua741,op27", "C=10pF,20pF")
NONE = float("nan")


@pytest.mark.parametrize(
    ("growth", "sentence"),
    [
        ([[-1.0, -2.0], [-1.0, -3.0]], "Stability is the same at every point."),
        ([[1.0, 2.0], [1.0, 3.0]], "Stability is the same at every point."),
        ([[-1.0, 2.0], [-1.0, -3.0]], "Stable at some points, unstable at others"),
        ([[-1.0, NONE], [-1.0, -3.0]], "Stability is the same where it is known."),
    ],
)
def test_a_map_of_lists_says_whether_its_points_are_stable(
    growth: list[list[float]], sentence: str
) -> None:
    assert sentence in Plane(grid_plan(*LISTS), np.array(growth)).note


def test_the_boundary_is_where_the_growth_rate_passes_through_zero() -> None:
    plan = grid_plan("C=10pF:30pF:2:lin", "gain=1k:2k:2:lin")
    plane = Plane(plan, np.array([[3.0, 3.0], [-1.0, -1.0]]))
    assert plane.edge is not None
    assert plane.edge.x[:2] == pytest.approx([25e-12, 25e-12])
    assert "interpolated between the points" in plane.note


def test_missing_values_are_not_called_small() -> None:
    data = {name: np.array([1.0, 2.0]) for name in SHOWN}
    data |= {"overshoot": np.array([NONE, NONE]), "undershoot": np.array([1e-9, NONE])}
    shown, lines = _worth(data)
    assert set(SHOWN) - set(shown) == {"overshoot", "undershoot"}
    assert lines == (
        "No value at any point: overshoot.",
        "Under 1 ppm of the step where it has one: undershoot.",
    )


@pytest.mark.parametrize("letters", range(30, 90, 7))
def test_no_last_line_of_a_title_is_one_short_word(letters: int) -> None:
    words = "The gain alone trades settling time against overshoot (R and C as they are)."
    lines = wrapped(words, letters).splitlines()
    lengths = list(map(len, lines))
    assert " ".join(lines) == words
    assert max(lengths) <= letters
    assert len(lines) == 1 or min(lengths) > 0.4 * max(lengths)
