"""Charts as a picture of matplotlib: PNG, SVG or PDF, or a figure for a notebook."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from taction.netlist_gen.kicad.sheet import GRID
from taction.system.charts import Axis, Chart, Columns, Limit, Mark, Text
from taction.verification.report.blocks import PICTURE, Bars, Block, Drawing, Notes, Page
from taction.verification.report.renderers.picture_chart import draw_chart, figure_file, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL = (5.0, 3.5)  # width and height of a chart, inches
ALONE = 1.8  # times the width of a chart: that of a single one
PIXELS = 112.0  # of a page, for an inch of a chart with more rows than usual
LEGEND = 1.5  # width of a legend beside a chart, inches
MOST = 12  # blocks of a picture
LETTER, SHORT = 0.085, 12  # width of a letter, inches; letters that have room beside any chart
SMALL = 12.0  # letters of a small text per inch
MOST_SHARE = 1.2  # of a limit: where a bar ends


def draw_page(page: Page, path: str | Path | None = None) -> Figure:
    """Draw the first charts of a page on a grid, other blocks below, to `path` if any."""
    found = list(page.blocks(PICTURE))
    drawn = [each for each in found if not isinstance(each, Notes)] or found
    drawn = sorted(drawn or [Notes("", (page.summary,))], key=lambda each: each.kind == "bars")
    leads = [each.lead for each in page.sections if PICTURE in each.media and each.lead]
    foot = next(iter([*leads, *(getattr(each, "summary", "") for each in drawn)]), "")
    title = ": ".join(filter(None, (page.title, page.summary)))
    return draw_blocks(title, drawn[:MOST], foot, path)


def draw_blocks(
    title: str, blocks: Sequence[Block], foot: str = "", path: str | Path | None = None
) -> Figure:
    """Draw charts, drawings, `Bars` and `Notes` on a grid below a title, see `draw_page`."""
    charts = [each for each in blocks if each.kind != "bars"]
    across = 2 if len(charts) == 4 else max(min(len(charts), 3), 1)
    lines = [charts[first : first + across] for first in range(0, len(charts), across)]
    lines += [[each] for each in blocks if each.kind == "bars"]  # a table has a row of its own
    columns = [PANEL[0] + max(map(_beside, charts[k::across]), default=0.0) for k in range(across)]
    if across == 1:
        columns = [ALONE * columns[0]]
    rows = [max(_height(block, sum(columns)) for block in line) for line in lines]
    with figure_file(path, sum(columns), sum(rows) + 0.6, title) as figure:
        grid = figure.add_gridspec(len(rows), across, width_ratios=columns, height_ratios=rows)
        for row, line in enumerate(lines):
            for column, block in enumerate(line):
                end = across if block.kind == "bars" else column + 1
                draw_block(figure.add_subplot(grid[row, column:end]), block)
        if foot:
            figure.supxlabel(wrapped(foot, SMALL * sum(columns)), fontsize="small")
    return figure


def _height(block: Block, width: float) -> float:
    """Return the height of a block, inches; a drawing fills the width of the picture."""
    if isinstance(block, Drawing):
        left, top, right, bottom = block.strokes.frame
        return width * (bottom - top) / (right - left)
    if isinstance(block, Bars):
        return _bars_chart(block).pixels / PIXELS
    return max(PANEL[1], (block.pixels if isinstance(block, Chart) else 0) / PIXELS)


def _beside(block: Block) -> float:
    """Return the width of a legend or of long names beside a chart, inches."""
    if not isinstance(block, Chart):
        return 0.0
    names = block.y.names if block.y.scale == "names" else ()
    letters = max((len(name) for name in names if len(name) > SHORT), default=0)
    return LETTER * letters + (LEGEND if block.legend == "beside" else 0.0)


def draw_block(axes: Axes, block: Block) -> None:
    """Draw a chart, a drawing, the table of `Bars`, or `Notes` into `axes`."""
    if type(block) not in BLOCKS:
        raise TypeError(f"a picture has no {block.kind}; expected a chart, bars or notes")
    BLOCKS[type(block)](axes, block)


def _notes(axes: Axes, notes: Notes) -> None:
    axes.axis("off")
    text = "\n".join(line for each in notes.lines for line in textwrap.wrap(each, 56))
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
    axes.set_title(notes.title, fontsize="medium")


def _drawing(axes: Axes, drawing: Drawing) -> None:
    from matplotlib.patches import Circle

    strokes, figure = drawing.strokes, cast("Figure", axes.figure)
    left, top, right, bottom = strokes.frame
    axes.set(aspect="equal", xlim=(left, right), ylim=(bottom, top))
    axes.set_axis_off()
    for line in strokes.lines:
        axes.plot(*zip(*line, strict=True), color="black", lw=0.9)
    for centre, radius, filled in strokes.circles:
        axes.add_patch(Circle(centre, radius, fill=filled, color="black", lw=0.9))
    points = 72.0 * figure.get_figwidth() / (right - left) / GRID  # of a millimetre
    for label in strokes.texts:
        side = "center" if label.anchor == "middle" else label.anchor
        level = "bottom" if label.kind == "label" else "center"
        axes.text(*label.at, label.text, ha=side, va=level, fontsize=points * label.size)


def _bars_chart(bars: Bars) -> Chart:
    """Return values beside their limits as bars, each with its outcome and its numbers."""
    count, rows = len(bars.rows), bars.rows
    shares = np.array([min(max(bar.share or 0.0, 0.0), MOST_SHARE) for bar in rows])
    looks = tuple(bar.fill for bar in rows)
    words = ((bar.outcome, bar.value.partition(" (")[0], bar.limit) for bar in rows)
    texts = (
        Text(", ".join(filter(None, each)), 1.02 * MOST_SHARE, place, ("right", "middle"), "ink")
        for place, each in enumerate(words)
    )
    marks: tuple[Mark, ...] = (Columns(np.arange(count), shares, "y", looks=looks), Limit(1.0))
    names = Axis(scale="names", names=tuple(bar.name for bar in rows), reverse=True)
    used = Axis("part of the limit", limits=(0.0, 2.0 * MOST_SHARE))
    return Chart(bars.title, used, names, (*marks, *texts))


BLOCKS: dict[type, Callable[[Any, Any], None]] = {
    Chart: draw_chart,
    Drawing: _drawing,
    Bars: lambda axes, bars: draw_chart(axes, _bars_chart(bars)),
    Notes: _notes,
}
