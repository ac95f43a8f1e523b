"""Figures of matplotlib that all pictures share, and the files that they are written to."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.system.charts import BLUE, ORANGE, PURPLE
from taction.system.output_files import check_package, replacing
from taction.system.results import MATPLOTLIB, check_plot_file
from taction.verification.report.texts import glued

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METADATA = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
LETTERS = 9.0  # of the title in an inch
MARGIN = 0.1  # beside every chart, inches
DPI = 100  # of the picture in a notebook
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


def wrapped(text: str, letters: float) -> str:
    """Return a text in the fewest lines of so many letters, which are about equally long.

    A number and its unit stay in one line, and no last line has a single short word.
    """
    whole, most = glued(text, "\N{NO-BREAK SPACE}"), max(30, int(letters))
    lines = textwrap.wrap(whole, most)
    for narrower in range(most - 1, len(whole) // max(len(lines), 1) - 1, -1):
        tried = textwrap.wrap(whole, narrower)
        if len(tried) > len(lines):
            break
        lines = tried
    return "\n".join(lines)


@contextmanager
def new_figure(width: float, height: float) -> Iterator[Figure]:
    """Give a figure of `width` by `height` inches in the style of all pictures.

    A notebook shows it, though pyplot does not know it, so nothing needs to be closed. InputError:
    matplotlib is not installed.
    """
    check_package(*MATPLOTLIB, "plot")
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            picture = io.BytesIO()
            with mpl.rc_context(STYLE):
                self.savefig(picture, format="png", dpi=DPI)
            return picture.getvalue()

    with mpl.rc_context(STYLE):
        figure = NotebookFigure(figsize=(width, height))
        figure.set_layout_engine("constrained", w_pad=MARGIN)
        FigureCanvasAgg(figure)
        yield figure


@contextmanager
def figure_file(
    path: str | Path | None, width: float, height: float, title: str = ""
) -> Iterator[Figure]:
    """Give a `new_figure` and write the finished picture to `path`, always with the same bytes.

    Without a `path` nothing is written. InputError: as `check_plot_file`, or the file cannot be
    written.
    """
    if path is not None:
        check_plot_file(path)
    with new_figure(width, height) as figure:
        if title:
            figure.suptitle(wrapped(title, LETTERS * width), fontweight="bold")
        yield figure
        if path is not None:
            with replacing(path) as file:
                figure.savefig(file, dpi=150, metadata=METADATA.get(Path(path).suffix.lower()))
