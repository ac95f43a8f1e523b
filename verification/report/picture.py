"""Colours of outcomes and labels of lines, and what all pictures share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taction.system.array_types import Floats
from taction.system.picture import check_plot_file as check_plot_file
from taction.system.picture import figure_file as figure_file
from taction.system.picture import new_figure as new_figure
from taction.system.picture import time_unit as time_unit
from taction.system.picture_style import BLUE as BLUE
from taction.system.picture_style import GREY as GREY
from taction.system.picture_style import ORANGE as ORANGE
from taction.system.picture_style import PURPLE as PURPLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OUTCOME_COLOURS = {"pass": BLUE, "fail": ORANGE, "inconclusive": GREY, "error": PURPLE}
HATCHES = {"pass": "", "fail": "////", "inconclusive": "....", "error": "xxxx"}
LEAST_GAP = 0.055  # between two labels, share of the height of the axes


def label_ends(axes: Axes, names: Sequence[str], ends: Floats, colours: Sequence[Any]) -> None:
    """Write the names of lines beside their right ends `ends` (n,), none over another."""
    low, high = axes.get_ylim()
    wanted = (np.asarray(ends) - low) / (high - low)
    for name, y, place, colour in zip(names, wanted, apart(wanted), colours, strict=True):
        axes.annotate(
            name, (1.0, y), (1.03, place), xycoords="axes fraction", textcoords="axes fraction",
            va="center", fontsize="small", color=colour, annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.6, "shrinkA": 1, "shrinkB": 0},
        )  # fmt: skip


def apart(wanted: Floats, gap: float = LEAST_GAP) -> Floats:
    """Return the places (n,) nearest to the wanted ones that are at least `gap` apart.

    Examples
    --------
    >>> apart(np.array([0.5, 0.5, 0.1]), 0.1).round(2).tolist()
    [0.45, 0.55, 0.1]
    """
    from scipy.optimize import isotonic_regression

    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(len(wanted))
    places = np.empty(len(wanted))
    places[order] = isotonic_regression(np.asarray(wanted)[order] - steps).x + steps
    return places
