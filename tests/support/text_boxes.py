"""Where the texts of a matplotlib figure lie: over another text, or beyond the edge."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text

TOUCH = 1.0  # pixels by which boxes may overlap: a box is larger than its letters


@contextmanager
def figures() -> Iterator[list[Figure]]:
    """Give the list of figures that are saved; no file is written."""
    saved: list[Figure] = []

    def keep(figure: Figure, file: Any, **_options: Any) -> None:
        figure.draw_without_rendering()  # which places everything
        saved.append(figure)

    with patch.object(Figure, "savefig", keep):
        yield saved


def texts_of(figure: Figure) -> list[tuple[str, Any]]:
    """Return the texts that are seen, with their boxes in pixels."""
    hidden = set()
    for axis in figure.findobj(Axis):
        scale = axis.get_transform().transform
        low, high = sorted(scale(axis.get_view_interval()))
        margin = 1e-6 * (high - low)
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        with np.errstate(divide="ignore", invalid="ignore"):
            places = [float(scale(np.array([tick.get_loc()]))[0]) for tick in ticks]
        inside = [low - margin <= place <= high + margin for place in places]
        outside = [tick for tick, seen in zip(ticks, inside, strict=True) if not seen]
        hidden |= {id(label) for tick in outside for label in (tick.label1, tick.label2)}
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    found = []
    for text in figure.findobj(Text):
        axes = text.axes
        shown = text.get_visible() and (axes is None or axes.get_visible())
        if not shown or not text.get_text().strip() or id(text) in hidden:
            continue
        box = text.get_window_extent(renderer)
        if box.width > 0.0 and box.height > 0.0:
            found.append((text.get_text(), box))
    return found


def overlapping(texts: list[tuple[str, Any]]) -> list[tuple[str, str]]:
    """Return pairs of texts that lie over each other, of `texts_of`."""
    found = []
    for k, (first, a) in enumerate(texts):
        for second, b in texts[k + 1 :]:
            width = min(a.x1, b.x1) - max(a.x0, b.x0)
            height = min(a.y1, b.y1) - max(a.y0, b.y0)
            if width > TOUCH and height > TOUCH:
                found.append((first, second))
    return found


def cut_off(figure: Figure, texts: list[tuple[str, Any]]) -> list[str]:
    """Return those of `texts_of` a figure that are not entirely within it."""
    whole = figure.bbox
    return [
        text
        for text, box in texts
        if box.x0 < whole.x0 - TOUCH
        or box.x1 > whole.x1 + TOUCH
        or box.y0 < whole.y0 - TOUCH
        or box.y1 > whole.y1 + TOUCH
    ]
