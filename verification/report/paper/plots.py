"""Pictures of the paper's reproduction as PNG."""

from __future__ import annotations

import importlib.util
import io
import math
from typing import TYPE_CHECKING

from taction.verification.evidence.paper.pictures import Panel, Picture
from taction.verification.report.picture import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, HEIGHT = 4.2, 3.3  # of one panel, inches
IN_A_ROW = 3
DPI = 110
LONG_LINE = 400  # points above which a line is thin


def can_draw() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def draw(picture: Picture) -> bytes:
    """Return `picture` as PNG; the same picture gives the same bytes."""
    count = len(picture.panels)
    columns = min(count, IN_A_ROW)
    rows = math.ceil(count / columns)
    with new_figure(max(columns * WIDTH, 1.5 * WIDTH), rows * HEIGHT) as figure:
        for number, panel in enumerate(picture.panels, start=1):
            _panel(figure.add_subplot(rows, columns, number), panel)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def _panel(axes: Axes, panel: Panel) -> None:
    for line in panel.curves:
        width = 0.6 if len(line.x) > LONG_LINE else 1.4
        axes.plot(line.x, line.y, line.style, label=line.label or None, lw=width, ms=4)
    for place, (level, text) in enumerate(panel.marks):
        axes.axhline(level, color=f"C{place + 1}", ls="--", lw=1, label=f"{text}: {level:.3g}")
    axes.set(xlabel=panel.x, ylabel=panel.y, **{f"{axis}scale": "log" for axis in panel.logs})
    if panel.limits is not None:
        axes.set_ylim(*panel.limits)
    axes.set_title(panel.title, fontsize="medium")
    if any(line.label for line in panel.curves) or panel.marks:
        axes.legend(fontsize="x-small")
