"""Files, style and colours that all pictures share. matplotlib is imported where it is used."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spice_models.array_types import Floats
from spice_models.atomic_files import replacing
from verification.report.output_checks import check_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MATPLOTLIB = ("matplotlib", "needs matplotlib: pip install 'taction[plot]'")
PACKAGES = dict.fromkeys((".png", ".svg", ".pdf"), MATPLOTLIB)
METADATA = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))
BLUE, ORANGE, GREY, PURPLE = "#0072b2", "#d55e00", "#7f7f7f", "#cc79a7"
"""Colours that stay apart for every kind of colour vision (Okabe and Ito)."""
OUTCOME_COLOURS = {"pass": BLUE, "fail": ORANGE, "inconclusive": GREY, "error": PURPLE}
HATCHES = {"pass": "", "fail": "////", "inconclusive": "....", "error": "xxxx"}
CYCLE = [BLUE, ORANGE, "#009e73", PURPLE, "#e69f00", "#56b4e9"]
STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.prop_cycle": f"cycler('color', {CYCLE})",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.6,
    "svg.hashsalt": "taction",  # the same picture gives the same bytes
}
LEAST_GAP = 0.055  # between two labels, share of the height of the axes


def check_plot_file(path: str) -> None:
    """Refuse a picture that could not be drawn, before any work is done.

    Raises
    ------
    InputError
        The ending is not in `PACKAGES`, the folder is missing, or matplotlib is not installed.
    """
    check_file(path, "--plot", PACKAGES, PACKAGES)


@contextmanager
def new_figure(width: float, height: float) -> Iterator[Figure]:
    """Give a figure of `width` by `height` inches in the style of all pictures."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


@contextmanager
def figure_file(path: str, width: float, height: float, title: str = "") -> Iterator[Figure]:
    """Give a `new_figure` and write the finished picture to `path`, always with the same bytes.

    Raises
    ------
    InputError
        See `check_plot_file`; or the file cannot be written.
    """
    check_plot_file(path)
    with new_figure(width, height) as figure:
        if title:
            figure.suptitle(title, fontweight="bold")
        yield figure
        with replacing(path) as file:
            figure.savefig(file, dpi=150, metadata=METADATA.get(Path(path).suffix.lower()))


def time_unit(longest: float) -> tuple[float, str]:
    """Return the unit of a time axis up to `longest`, s: its length in s, and its name."""
    return next(((size, name) for size, name in UNITS if longest >= size), UNITS[-1])


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
