"""Charts as a picture of matplotlib: PNG, SVG or PDF, or a figure for a notebook."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from taction.netlist_gen.kicad.sheet import GRID
from taction.verification.report.blocks import Bars, Block, Drawing, Notes, Page, Sheet
from taction.verification.report.charts import OUTCOMES, Chart
from taction.verification.report.renderers.figures import figure_file, wrapped
from taction.verification.report.renderers.picture_chart import draw_chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 5.2, 3.6  # of a chart, inches, where the sheet has no size
SMALL = 12.0  # letters of a small text per inch
MOST_LINES = 12  # below the checks
ROW = 0.27  # height of a row of the checks, inches


def draw_sheet(sheet: Sheet, path: str | Path | None = None) -> Figure:
    """Draw the charts of `sheet`, and write the figure to `path`, if there is one.

    Raises
    ------
    InputError
        See `figure_file`.
    """
    columns = [column for column in sheet.columns if column]
    rows = max(map(len, columns))
    width, height = sheet.size
    width, height = width or WIDTH * len(columns), height or HEIGHT * rows + 0.5
    with figure_file(path, width, height, sheet.title) as figure:
        grid = figure.add_gridspec(1, len(columns), width_ratios=sheet.widths or None)
        for place, column in enumerate(columns):
            ratios: Any = sheet.heights[place] if sheet.heights else None
            count = len(column) if ratios else rows
            cells: Any = grid[place].subgridspec(count, 1, height_ratios=ratios)
            for cell, block in zip(cells, column, strict=False):
                draw_block(figure.add_subplot(cell), block)
        if sheet.foot:
            figure.supxlabel(wrapped(sheet.foot, SMALL * width), fontsize="small")
    return figure


def draw_page(page: Page, path: str | Path | None = None) -> Figure:
    """Draw the sheet of `page`, see `draw_sheet`.

    Raises
    ------
    ValueError
        The page has no picture.
    """
    if page.sheet is None:
        raise ValueError(f"{page.command} has no picture")
    return draw_sheet(page.sheet(), path)


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


def _draw_bars(axes: Axes, bars: Bars) -> None:
    """Write a table of values with their limits, and below it why one does not pass."""
    from matplotlib.transforms import Bbox

    axes.axis("off")
    rows = [(b.name, b.outcome, b.value.partition(" (")[0], b.limit) for b in bars.rows]
    if not rows:
        return
    figure: Any = axes.figure
    height = ROW * figure.dpi / axes.bbox.height
    bottom = 1.0 - height * (len(rows) + 1)
    table = axes.table(
        rows, colLabels=("check", "outcome", "value", "limit"), colWidths=_widths(rows),
        cellLoc="left", colLoc="left", edges="B",
        bbox=Bbox.from_bounds(0.0, bottom, 1.0, 1.0 - bottom),
    )  # fmt: skip
    table.auto_set_font_size(False)
    table.set_fontsize(8.5)
    for place, bar in enumerate(bars.rows, 1):
        if bar.outcome:
            cell = table[place, 1].get_text()
            cell.set(color=OUTCOMES[bar.outcome].colour, weight="bold")
    letters = int(62 * axes.bbox.width / figure.dpi / 4.3)
    reasons = [
        line
        for bar in sorted(bars.rows, key=lambda bar: bar.outcome == "pass")
        if bar.reason and bar.outcome != "pass"
        for line in textwrap.wrap(f"{bar.name}: {bar.reason}", letters)
    ]
    if len(reasons) > MOST_LINES:
        reasons = [*reasons[: MOST_LINES - 1], "…"]
    axes.text(0.0, bottom - 0.03, "\n".join(reasons), va="top", fontsize=8)


def _widths(rows: Sequence[Sequence[str]]) -> list[float]:
    """Return the widths of the columns, by their longest texts."""
    longest = [max(9, *(len(row[place]) for row in rows)) + 1.0 for place in range(4)]
    return [each / sum(longest) for each in longest]


BLOCKS: dict[type, Callable[[Any, Any], None]] = {
    Chart: draw_chart,
    Drawing: _drawing,
    Bars: _draw_bars,
    Notes: _notes,
}
