"""Charts as a picture of matplotlib: PNG, SVG or PDF, or a figure for a notebook."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from taction.system import charts
from taction.system.array_types import Floats
from taction.system.charts import Axis, Chart
from taction.system.output_files import check_extra, check_file, replacing
from taction.verification.report.blocks import PICTURE, Bars, Block, Notes, Page
from taction.verification.report.texts import figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

METADATA = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
TITLE_LETTERS = 9.0  # of the title in an inch
MARGIN = 0.1  # beside every chart, inches
DPI = 100  # of the picture in a notebook
STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.6,
    "svg.hashsalt": "taction",  # the same picture gives the same bytes
}
PANEL = (5.0, 3.5)  # width and height of a chart, inches
ALONE = 1.8  # times the width of a chart: that of a single one
PIXELS = 112.0  # of a page, for an inch of a high chart
ROW = 0.27  # height of a bar, inches
MOST = 12  # blocks of a picture
WORD = 10  # letters that a line may have beyond an equal share
SMALL = 12.0  # letters of a small text per inch
MOST_SHARE = 1.2  # of a limit: where a bar ends
LETTERS = 13.0  # of a title per inch of the chart's width
MARKS = {
    "circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "triangle-down": "v",
    "triangle-left": "<", "triangle-right": ">", "x": "x", "cross": "P", "star": "*",
    "hourglass": "X", "hexagon": "h", "pentagon": "p", "line-ns": "|",
}  # fmt: skip
LINES = {"solid": "-", "dash": (0, (4.0, 4.0)), "dot": ":", "dashdot": "-.", "": "none"}
THEME = {"ink": "#1a1a1a", "muted": "#555555", "band": "#d9d9d9", "true": charts.GREY}
DIVERGING = (charts.BLUE, "#f4f4f2", charts.ORANGE)
FEW = 5  # steps between labels that may be long
LEGEND = 0.6  # opacity of a legend, which stands where it hides least
BELOW, ENTRY = 4.6, 6  # font sizes from the axes to a legend below; letters beside its names


def draw_page(page: Page, path: str | Path | None = None) -> Figure:
    """Draw the first charts of a page on a grid, other blocks below, to `path` if any."""
    if path is not None:
        check_file(str(path), "--plot")
    check_extra("plot", "plot")
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawn = _drawn(page)
        if path is not None:
            with replacing(path) as file:
                drawn.savefig(file, dpi=150, metadata=METADATA.get(Path(path).suffix.lower()))
    return drawn


def _drawn(page: Page) -> Figure:
    found = list(page.blocks(PICTURE))
    shown: list[Block] = [each for each in found if not isinstance(each, Notes)]
    blocks = (shown or found)[:MOST] or [Notes("", (page.summary,))]
    panels: list[Block] = [each for each in blocks if not isinstance(each, Bars)]
    across = 2 if len(panels) == 4 else max(min(len(panels), 3), 1)
    lines = [panels[first : first + across] for first in range(0, len(panels), across)]
    lines += [[each] for each in blocks if isinstance(each, Bars)]
    width = PANEL[0] * (across if across > 1 else ALONE)
    rows = [max(map(_height, line)) for line in lines]
    figure = _new_figure(width, sum(rows) + 0.6)
    if title := ": ".join(filter(None, (page.title, page.summary))):
        figure.suptitle(wrapped(title, TITLE_LETTERS * width), fontweight="bold")
    grid = figure.add_gridspec(len(rows), across, height_ratios=rows)
    for row, line in enumerate(lines):
        for column, block in enumerate(line):
            end = column + 1 if row * across < len(panels) else across
            BLOCKS[type(block)](figure.add_subplot(grid[row, column:end]), block)
    leads = [each.lead for each in page.sections if PICTURE in each.media and each.lead]
    first = getattr(blocks[0], "summary", "")
    foot = leads[0] if leads else "First chart: " * bool(first and blocks[1:]) + first
    figure.supxlabel(wrapped(foot, SMALL * width), fontsize="small")
    return figure


def _new_figure(width: float, height: float) -> Figure:
    """Return a figure of so many inches, which a notebook shows in the same style."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            picture = io.BytesIO()
            with mpl.rc_context(STYLE):
                self.savefig(picture, format="png", dpi=DPI)
            return picture.getvalue()

    figure = NotebookFigure(figsize=(width, height))
    figure.set_layout_engine("constrained", w_pad=MARGIN)
    FigureCanvasAgg(figure)
    return figure


def _height(block: Block) -> float:
    """Return the height of a block, inches."""
    if isinstance(block, Bars):
        return 0.9 + ROW * len(block.rows)
    return max(PANEL[1], block.height / PIXELS) if isinstance(block, Chart) else PANEL[1]


def wrapped(text: str, letters: float) -> str:
    """Return a text in lines of so many letters at most, which are about equally long."""
    most = max(30, int(letters))
    even = len(text) // max(len(textwrap.wrap(text, most)), 1) + WORD
    return textwrap.fill(text, min(most, even))


def _notes(axes: Axes, notes: Notes) -> None:
    axes.axis("off")
    text = "\n".join(line for each in notes.lines for line in textwrap.wrap(each, 56))
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
    axes.set_title(notes.title, fontsize="medium")


def _bars(axes: Axes, bars: Bars) -> None:
    """Draw values beside their limits, each with its outcome and its numbers."""
    for place, bar in enumerate(bars.rows):
        share = min(max(bar.share or 0.0, 0.0), MOST_SHARE)
        look: Any = {"color": colour(bar.fill), "hatch": hatch(bar.fill), "edgecolor": "white"}
        axes.barh(place, share, linewidth=0.4, **look)
        words = filter(None, (bar.outcome, bar.value.partition(" (")[0], bar.limit))
        axes.text(1.02 * MOST_SHARE, place, ", ".join(words), va="center", fontsize="small")
    axes.axvline(1.0, color=THEME["ink"], ls="--", lw=1.0)
    axes.set_yticks(range(len(bars.rows)), [bar.name for bar in bars.rows])
    axes.set(xlim=(0.0, 2.0 * MOST_SHARE), ylim=(len(bars.rows) - 0.5, -0.5))
    axes.set(xlabel="part of the limit", title=bars.title)
    axes.grid(visible=False, axis="y")


def draw_chart(axes: Axes, chart: Chart) -> None:
    """Draw `chart` into `axes`."""
    for name, axis in chart.axes:
        if axis.scale == "log":
            getattr(axes, f"set_{name}scale")("log")
    for mark in chart.marks:
        DRAWERS[type(mark)](axes, mark, chart)
    for name, axis in chart.axes:
        ends = (-0.5, len(axis.names) - 0.5) if axis.names else axis.limits
        if ends is not None:
            getattr(axes, f"set_{name}lim")(*(axis.factor * end for end in ends))
        if axis.reverse:
            getattr(axes, f"invert_{name}axis")()
        _label(axes, axis, name)
    handles, names = axes.get_legend_handles_labels()
    if chart.legend and names:
        known = dict(zip(names, handles, strict=True))  # each name once
        points = any(isinstance(mark, charts.Curve) and not mark.line for mark in chart.marks)
        place: dict[str, Any] = {"loc": "best", "framealpha": LEGEND}
        if points:  # anywhere they may lie: the legend stands below
            across = max(1, int(SMALL * _inches(axes) / (ENTRY + max(map(len, known)))))
            place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncols": across}
            place["borderaxespad"] = BELOW
        axes.legend([*known.values()], [*known], fontsize="small", **place)
    axes.set_title(wrapped(chart.title, LETTERS * _inches(axes)), fontsize="medium")


def colour(name: str) -> str:
    """Return a colour of a chart as hexadecimal RGB."""
    if name in charts.OUTCOMES:
        return charts.OUTCOMES[name].colour
    return THEME.get(name, name)


def hatch(name: str) -> str:
    """Return the hatching of an outcome; other colours have none."""
    return charts.OUTCOMES[name].hatch if name in charts.OUTCOMES else ""


def cell_edges(places: ArrayLike, *, log: bool = False) -> Floats:
    """Return the edges (n + 1,) of the cells around `places` (n,).

    >>> cell_edges([1.0, 2.0, 4.0]).tolist(), cell_edges([1.0, 100.0], log=True).round(3).tolist()
    ([0.5, 1.5, 3.0, 5.0], [0.1, 10.0, 1000.0])
    """
    inner = np.asarray(places, dtype=np.float64)
    inner = np.log(inner) if log else inner
    half = 0.5 * np.diff(inner) if len(inner) > 1 else np.array([0.5])
    between = inner[:-1] + half if len(inner) > 1 else inner[:0]
    edges = np.concatenate([[inner[0] - half[0]], between, [inner[-1] + half[-1]]])
    return np.exp(edges) if log else np.asarray(edges)


def _values(values: ArrayLike, axis: Axis) -> Floats:
    return np.asarray(np.asarray(values, dtype=np.float64) * axis.factor)


def _label(axes: Axes, axis: Axis, name: str) -> None:
    """Write the title and the ticks of an axis; the unit stands at each number."""
    from matplotlib import ticker

    ruler: Any = getattr(axes, f"{name}axis")
    ruler.set_label_text(axis.caption)
    if axis.scale == "names":
        ruler.set_ticks(range(len(axis.names)), axis.names)
        letters = sum(len(each) + 2 for each in axis.names)
        if name == "x" and letters > LETTERS * _inches(axes):  # they cannot stand beside each other
            axes.tick_params("x", labelrotation=30)
        return
    unit, log = axis.sign.strip("%"), axis.scale == "log"
    if unit:
        ruler.set_major_formatter(ticker.EngFormatter(unit))
    if log:
        low, high = sorted(ruler.get_view_interval())
        short = high < (300.0 if name == "y" else 60.0) * low
        if not unit:
            plain, powers = ticker.StrMethodFormatter("{x:g}"), ticker.LogFormatterMathtext()
            ruler.set_major_formatter(plain if short else powers)
        ruler.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0) if short else (1.0,)))
        ruler.set_minor_formatter(ticker.NullFormatter())
    elif axis.whole or unit or name == "x":
        ruler.set_major_locator(
            ticker.MaxNLocator(integer=True) if axis.whole else ticker.MaxNLocator(FEW)
        )


def _inches(axes: Axes) -> float:
    """Return the width of the axes before the layout, inches."""
    return float(cast("Figure", axes.figure).get_figwidth() * axes.get_position().width)


def _curve(axes: Axes, mark: charts.Curve, chart: Chart) -> None:
    look, shape = colour(mark.colour), mark.mark.removesuffix("-open")
    style: dict[str, Any] = {
        "color": look, "lw": mark.width, "ls": LINES[mark.line],
        "marker": MARKS.get(shape, "o") if shape else "none", "ms": mark.size, "mec": look,
        "mfc": look if shape == mark.mark else "none", "zorder": 1.5 if mark.behind else 2.5,
        "label": mark.name if mark.label == "legend" and mark.name else None,
    }  # fmt: skip
    axes.plot(_values(mark.x, chart.x), _values(mark.y, chart.y), **style)


def _limit(axes: Axes, mark: charts.Limit, chart: Chart) -> None:
    axis = getattr(chart, mark.across)
    draw = axes.axvline if mark.across == "x" else axes.axhline
    look: dict[str, Any] = {"color": colour(mark.colour), "ls": LINES[mark.line], "lw": mark.width}
    draw(axis.factor * mark.value, label=mark.name or None, zorder=1.8, **look)


def _band(axes: Axes, mark: charts.Band, chart: Chart) -> None:
    factor = getattr(chart, mark.across).factor
    draw = axes.axvspan if mark.across == "x" else axes.axhspan
    look, ends = colour(mark.colour), (factor * mark.low, factor * mark.high)
    more: dict[str, Any] = {"zorder": 0, "label": mark.name or None, "lw": 0.0}
    draw(*ends, color=look, alpha=0.15 if mark.colour in charts.OUTCOMES else 1.0, **more)


def _columns(axes: Axes, mark: charts.Columns, chart: Chart) -> None:
    looks: Any = {"color": [*map(colour, mark.looks)], "hatch": [*map(hatch, mark.looks)]}
    places, widths = _values(mark.places, chart.x), _values(mark.widths, chart.x)
    axes.bar(places, _values(mark.sizes, chart.y), widths, edgecolor="white", lw=0.4, **looks)


def _grid(axes: Axes, mark: charts.Grid, chart: Chart) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    axes.set_facecolor("0.85")
    across, down = (
        cell_edges(_values(places, axis), log=axis.scale == "log")
        for places, axis in ((mark.x, chart.x), (mark.y, chart.y))
    )
    axes.grid(visible=False)
    axes.set(xlim=across[[0, -1]], ylim=down[[0, -1]])
    places, labels = charts.levels(mark, np.asarray(mark.values, dtype=np.float64))
    if not labels:
        axes.text(0.5, 0.5, "nowhere", transform=axes.transAxes, ha="center")
        return
    colours: Any = "viridis"
    if mark.scale == "signed":
        colours = LinearSegmentedColormap.from_list("signed", DIVERGING)
    shown = np.ma.masked_invalid(places)
    mesh = axes.pcolormesh(across, down, shown, vmin=0.0, vmax=1.0, cmap=colours)
    picture: Any = axes.figure
    bar = picture.colorbar(mesh, ax=axes, pad=0.015)
    texts = {figure(value, mark.unit, 3): place for place, value in labels}
    bar.set_ticks([*texts.values()], labels=[*texts])
    bar.ax.minorticks_off()
    for y, row in zip(_values(mark.y, chart.y), mark.written, strict=False):
        for x, text in zip(_values(mark.x, chart.x), row, strict=True):
            axes.text(x, y, text, ha="center", va="center", fontsize="small")


def _text(axes: Axes, mark: charts.Text, chart: Chart) -> None:
    side, level = mark.align
    beyond = mark.x is None and level == "middle"
    place: list[Any] = []
    for value, axis, edge in (
        (mark.x, chart.x, {"left": 0.99, "right": 1.01 if beyond else 0.01, "middle": 0.5}[side]),
        (mark.y, chart.y, {"above": 0.02, "below": 0.98, "middle": 0.5}[level]),
    ):
        place.append((edge, "axes fraction") if value is None else (axis.factor * value, "data"))
    axes.annotate(
        mark.text, (place[0][0], place[1][0]), xycoords=(place[0][1], place[1][1]),
        ha={"left": "right", "right": "left", "middle": "center"}[side],
        va={"above": "bottom", "below": "top", "middle": "center"}[level],
        fontsize="small", color=colour(mark.colour), annotation_clip=False,
    )  # fmt: skip


DRAWERS: dict[type, Callable[[Any, Any, Chart], None]] = {
    charts.Curve: _curve,
    charts.Limit: _limit,
    charts.Band: _band,
    charts.Columns: _columns,
    charts.Grid: _grid,
    charts.Text: _text,
}


BLOCKS: dict[type, Callable[[Any, Any], None]] = {Chart: draw_chart, Bars: _bars, Notes: _notes}
