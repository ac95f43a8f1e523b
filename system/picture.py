"""Figures and files that all pictures share. matplotlib is imported where it is used."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from taction.system.atomic_files import replacing
from taction.system.output_files import check_file, check_package
from taction.system.picture_style import STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MATPLOTLIB = ("matplotlib", "needs matplotlib: pip install 'taction[plot]'")
PACKAGES = dict.fromkeys((".png", ".svg", ".pdf"), MATPLOTLIB)
METADATA = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))


def check_plot_file(path: str | Path) -> None:
    """Refuse a picture that could not be drawn, before any work is done.

    Raises
    ------
    InputError
        The ending is not in `PACKAGES`, the folder is missing, or matplotlib is not installed.
    """
    check_file(str(path), "--plot", PACKAGES, PACKAGES)


@contextmanager
def new_figure(width: float, height: float) -> Iterator[Figure]:
    """Give a figure of `width` by `height` inches in the style of all pictures.

    Raises
    ------
    InputError
        matplotlib is not installed.
    """
    check_package(*MATPLOTLIB, "plot")
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from taction.system.notebook_figure import NotebookFigure

    with mpl.rc_context(STYLE):
        figure = NotebookFigure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


@contextmanager
def figure_file(
    path: str | Path | None, width: float, height: float, title: str = ""
) -> Iterator[Figure]:
    """Give a `new_figure` and write the finished picture to `path`, always with the same bytes.

    Without a `path` nothing is written.

    Raises
    ------
    InputError
        See `check_plot_file`; or the file cannot be written.
    """
    if path is not None:
        check_plot_file(path)
    with new_figure(width, height) as figure:
        if title:
            figure.suptitle(title, fontweight="bold")
        yield figure
        if path is not None:
            with replacing(path) as file:
                figure.savefig(file, dpi=150, metadata=METADATA.get(Path(path).suffix.lower()))


def time_unit(longest: float) -> tuple[float, str]:
    """Return the unit of a time axis up to `longest`, s: its length in s, and its name."""
    return next(((size, name) for size, name in UNITS if longest >= size), UNITS[-1])
