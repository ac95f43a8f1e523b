"""A figure of matplotlib, its file, and one chart in it: marks, axes, labels and legend."""

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
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from taction.system import charts
from taction.system.array_types import Floats
from taction.verification.report.texts import figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

METADATA = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
TITLE_LETTERS = 9.0  # of the title in an inch
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
    """Give a figure of `width` by `height` inches in the style of all pictures."""
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
    """Give a `new_figure` and write it to `path`, if any, always with the same bytes."""
    if path is not None:
        check_plot_file(path)
    with new_figure(width, height) as figure:
        if title:
            figure.suptitle(wrapped(title, TITLE_LETTERS * width), fontweight="bold")
        yield figure
        if path is not None:
            with replacing(path) as file:
                figure.savefig(file, dpi=150, metadata=METADATA.get(Path(path).suffix.lower()))


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
LABELLED = 0.5  # height of the ticks and the label of the horizontal axis, inches
TURNED = 0.3  # more height of turned names, inches


def draw_chart(axes: Axes, chart: charts.Chart) -> None:
    """Draw `chart` into `axes`."""
    for name in ("x", "y"):
        if getattr(chart, name).scale == "log":
            getattr(axes, f"set_{name}scale")("log")
    for mark in chart.marks:
        DRAWERS[type(mark)](axes, mark, chart)
    first = chart.views[0] if chart.views else None
    for name, limits in (("x", first and first.x), ("y", first and first.y)):
        axis: charts.Axis = getattr(chart, name)
        ends = limits or axis.limits
        if ends is not None:
            low, high = (axis.factor * end for end in ends)
            getattr(axes, f"set_{name}lim")(low, high)
        if axis.reverse:
            getattr(axes, f"invert_{name}axis")()
    for name in ("x", "y"):
        _label(axes, chart, name)
    _legend(axes, chart)
    if chart.heading:
        axes.set_title(wrapped(chart.heading, LETTERS * _inches(axes)), fontsize="medium")


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

    Examples
    --------
    >>> cell_edges([1.0, 2.0, 4.0]).tolist(), cell_edges([1.0, 100.0], log=True).round(3).tolist()
    ([0.5, 1.5, 3.0, 5.0], [0.1, 10.0, 1000.0])
    """
    inner = np.asarray(places, dtype=np.float64)
    inner = np.log(inner) if log else inner
    half = 0.5 * np.diff(inner) if len(inner) > 1 else np.array([0.5])
    between = inner[:-1] + half if len(inner) > 1 else inner[:0]
    edges = np.concatenate([[inner[0] - half[0]], between, [inner[-1] + half[-1]]])
    return np.exp(edges) if log else np.asarray(edges)


def _values(values: ArrayLike, axis: charts.Axis) -> Floats:
    return np.asarray(np.asarray(values, dtype=np.float64) * axis.factor)


def _label(axes: Axes, chart: charts.Chart, name: str) -> None:
    """Write the title and the ticks of an axis; the unit stands at each number."""
    from matplotlib.ticker import EngFormatter, LogLocator, MaxNLocator, NullFormatter

    axis: charts.Axis = getattr(chart, name)
    ruler: Any = getattr(axes, f"{name}axis")
    getattr(axes, f"set_{name}label")(axis.caption)
    if axis.scale == "names":
        getattr(axes, f"set_{name}ticks")(range(len(axis.names)), axis.names)
        ends = (-0.5, len(axis.names) - 0.5)
        getattr(axes, f"set_{name}lim")(*(ends[::-1] if axis.reverse else ends))
        if name == "x" and _crowded(axes, axis):
            axes.tick_params("x", labelrotation=30)
        return
    unit, log = axis.sign.strip("%"), axis.scale == "log"
    ruler.set_major_formatter(EngFormatter(unit) if unit else _power if log else _plain)
    if log:
        low, high = sorted(getattr(axes, f"get_{name}lim")())
        short = high < (300.0 if name == "y" else 60.0) * low
        ruler.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if short else (1.0,)))
        ruler.set_minor_formatter(NullFormatter())
    elif axis.whole:
        ruler.set_major_locator(MaxNLocator(integer=True))
    elif unit or name == "x":
        ruler.set_major_locator(MaxNLocator(FEW))


def _plain(value: float, _: object = None) -> str:
    return f"{value:.6g}".replace("-", "−")


def _inches(axes: Axes) -> float:
    """Return the width of the axes before the layout, inches."""
    figure: Any = axes.figure
    return float(figure.get_figwidth() * axes.get_position().width)


def _crowded(axes: Axes, axis: charts.Axis) -> bool:
    """Tell whether the names of a horizontal axis are too long to stand beside each other."""
    return sum(len(name) + 2 for name in axis.names) > LETTERS * _inches(axes)


def _power(value: float, _: object = None) -> str:
    """Return a tick of a logarithmic axis, far ones as powers of ten, which are short."""
    if 1e-3 <= value < 1e5:
        return f"{value:g}"
    digit, _, exponent = f"{value:.0e}".partition("e")
    return f"${digit}\\cdot10^{{{int(exponent)}}}$".replace("$1\\cdot", "$")


def _marker(name: str, look: str, size: float) -> dict[str, Any]:
    shape = name.removesuffix("-open")
    open_mark = name.endswith("-open")
    return {
        "marker": MARKS.get(shape, "o") if name else "none", "ms": size,
        "mfc": "none" if open_mark else look, "mec": look,
    }  # fmt: skip


def _curve(axes: Axes, mark: charts.Curve, chart: charts.Chart) -> None:
    x, y, look = _values(mark.x, chart.x), _values(mark.y, chart.y), colour(mark.colour)
    name = mark.name if mark.label == "legend" and mark.name else None
    style: dict[str, Any] = {"color": look, "lw": mark.width, "ls": LINES[mark.line]}
    style |= {"zorder": 1.5 if mark.behind else 2.5, "label": name}
    style |= _marker(mark.mark, look, mark.size)
    axes.plot(x, y, **style)


def _limit(axes: Axes, mark: charts.Limit, chart: charts.Chart) -> None:
    axis = getattr(chart, mark.across)
    draw = axes.axvline if mark.across == "x" else axes.axhline
    look: dict[str, Any] = {"color": colour(mark.colour), "ls": LINES[mark.line], "lw": mark.width}
    draw(axis.factor * mark.value, label=mark.name or None, zorder=1.8, **look)


def _band(axes: Axes, mark: charts.Band, chart: charts.Chart) -> None:
    factor = getattr(chart, mark.across).factor
    draw = axes.axvspan if mark.across == "x" else axes.axhspan
    look, ends = colour(mark.colour), (factor * mark.low, factor * mark.high)
    more: dict[str, Any] = {"zorder": 0, "label": mark.name or None, "lw": 0.0}
    draw(*ends, color=look, alpha=0.15 if mark.colour in charts.OUTCOMES else 1.0, **more)


def _columns(axes: Axes, mark: charts.Columns, chart: charts.Chart) -> None:
    upright, other = mark.across == "x", "y" if mark.across == "x" else "x"
    own, along = getattr(chart, mark.across), getattr(chart, other)
    places, sizes = _values(mark.places, own), _values(mark.sizes, along)
    widths = 0.8 if mark.widths is None else _values(mark.widths, own)
    looks = mark.looks * len(sizes) if len(mark.looks) == 1 else mark.looks
    draw: Any = axes.bar if upright else axes.barh
    draw(
        places, sizes, widths,
        color=[colour(look) for look in looks], hatch=[hatch(look) for look in looks],
        edgecolor="white", linewidth=0.4, label=mark.name or None,
    )  # fmt: skip
    if not upright:
        axes.grid(visible=False, axis="y")


def _edges(mark: charts.Grid | charts.Cells, chart: charts.Chart) -> tuple[Floats, Floats]:
    found = [
        cell_edges(_values(places, axis), log=axis.scale == "log")
        for places, axis in ((mark.x, chart.x), (mark.y, chart.y))
    ]
    return found[0], found[1]


def _grid(axes: Axes, mark: charts.Grid, chart: charts.Chart) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    axes.set_facecolor("0.85")
    axes.grid(visible=False)
    across, down = _edges(mark, chart)
    axes.set(xlim=across[[0, -1]], ylim=down[[0, -1]])
    places, labels = charts.levels(mark, np.asarray(mark.values, dtype=np.float64))
    if not labels:
        axes.text(0.5, 0.5, "nowhere", transform=axes.transAxes, ha="center")
        return
    colours: Any = LinearSegmentedColormap.from_list("shares", DIVERGING)
    if mark.scale in ("linear", "log"):
        colours = "viridis"
    shown = np.ma.masked_invalid(places)
    mesh = axes.pcolormesh(across, down, shown, vmin=0.0, vmax=1.0, cmap=colours)
    if mark.bar:
        picture: Any = axes.figure
        bar = picture.colorbar(mesh, ax=axes, pad=0.015)
        texts = {figure(value, mark.unit, 3): place for place, value in labels}
        bar.set_ticks([*texts.values()], labels=[*texts])
        bar.ax.minorticks_off()
    for y, row in zip(_values(mark.y, chart.y), mark.written, strict=False):
        for x, text in zip(_values(mark.x, chart.x), row, strict=True):
            axes.text(x, y, text, ha="center", va="center", fontsize="small")


def _cells(axes: Axes, mark: charts.Cells, chart: charts.Chart) -> None:
    from matplotlib.colors import ListedColormap

    across, down = _edges(mark, chart)
    axes.set_facecolor("white")
    axes.grid(visible=False)
    axes.set(xlim=across[[0, -1]], ylim=down[[0, -1]])
    for name, look in mark.looks.items():
        cells = np.ma.masked_not_equal((mark.names == name).astype(np.int8), 1)
        if cells.count():
            axes.pcolor(
                across, down, cells, cmap=ListedColormap([look.colour]), hatch=look.hatch,
                edgecolor="white" if look.hatch else "none", linewidth=0.0,
            )  # fmt: skip


def _text(axes: Axes, mark: charts.Text, chart: charts.Chart) -> None:
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


DRAWERS: dict[type, Callable[[Any, Any, charts.Chart], None]] = {
    charts.Curve: _curve,
    charts.Limit: _limit,
    charts.Band: _band,
    charts.Columns: _columns,
    charts.Grid: _grid,
    charts.Cells: _cells,
    charts.Text: _text,
}


def _legend(axes: Axes, chart: charts.Chart) -> None:
    from matplotlib.patches import Patch
    from matplotlib.transforms import ScaledTranslation

    cells = [mark for mark in chart.marks if isinstance(mark, charts.Cells)]
    keys: dict[str, Any] = {
        look.name: Patch(facecolor=look.colour, hatch=look.hatch, edgecolor="white")
        for mark in cells
        for look in mark.looks.values()
    }
    handles, names = axes.get_legend_handles_labels()
    keys |= dict(zip(names, handles, strict=True))
    if not chart.legend or not keys:
        return
    figure: Any = axes.figure
    lower = LABELLED + TURNED * _crowded(axes, chart.x)
    across = max(1, min(3, int(LETTERS * _inches(axes) / (6 + max(map(len, keys))))))
    places: dict[str, dict[str, Any]] = {
        "beside": {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)},
        "below": {
            "loc": "upper center",
            "bbox_to_anchor": (0.5, 0.0),
            "ncols": across,
            "bbox_transform": axes.transAxes
            + ScaledTranslation(0.0, -lower, figure.dpi_scale_trans),
        },
        "inside": {"loc": "best"},
    }
    axes.legend([*keys.values()], [*keys], fontsize="small", **places[chart.legend])
