"""`NotebookFigure`: a matplotlib figure that a notebook shows, also without pyplot."""

from __future__ import annotations

import io

import matplotlib as mpl
from matplotlib.figure import Figure

from taction.system.picture_style import STYLE

DPI = 100  # of the picture in a notebook


class NotebookFigure(Figure):
    """A figure with its own picture; pyplot does not know it, so nothing needs to be closed."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        with mpl.rc_context(STYLE):
            self.savefig(picture, format="png", dpi=DPI)
        return picture.getvalue()
