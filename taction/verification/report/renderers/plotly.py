"""A chart as `data` and `layout` of Plotly, for pages and for the explorer.

A colour that begins with ``--`` is one of the style sheet; page.js puts it in.
"""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taction.system import charts
from taction.verification.report.texts import figure

PACKED = 64  # points from which numbers are packed
LETTER = 6.5  # width of a letter beside a chart, pixels
HATCH = {"fgcolor": "rgba(255,255,255,0.75)", "fillmode": "overlay", "size": 6}
PATTERNS = {"////": "/", "\\\\\\\\": "\\", "xxxx": "x", "....": ".", "++++": "+", "": ""}
MAP = [[0, "--map-low"], [1, "--map-high"]]
SIGNED = [[0, "--positive"], [0.5, "--neutral"], [1, "--negative"]]
CROWDED = (0.9, 2.5)  # decades over which Plotly would label every digit; here 1, 2 and 5
FEW = 8  # values of an axis of whole numbers up to which Plotly would label halves, too


def plotly_spec(chart: charts.Chart) -> dict[str, Any]:
    """Return `chart` as `data` and `layout` of Plotly, without its title."""
    kinds = {type(mark) for mark in chart.marks}
    texts = [_text(mark, chart) for mark in chart.marks if isinstance(mark, charts.Text)]
    straight = (mark for mark in chart.marks if isinstance(mark, charts.Limit | charts.Band))
    shapes = [_shape(mark, chart) for mark in straight]
    drawn = (mark for mark in chart.marks if type(mark) in TRACES)
    data = [trace for mark in drawn for trace in TRACES[type(mark)](mark, chart)]
    named = any(each.get("showlegend", True) for each in (*data, *shapes))
    layout: dict[str, Any] = {
        **{f"{name}axis": _axis(chart, name, axis) for name, axis in chart.axes},
        "shapes": shapes,
        "annotations": texts,
        "showlegend": chart.legend and named,
        "hovermode": "closest",
        "margin": _margin(chart, texts),
    }
    if charts.Columns in kinds:
        layout |= {"barmode": "overlay", "bargap": 0.0}
    if charts.Grid in kinds:
        layout["plot_bgcolor"] = "--card"
    return {"data": data, "layout": layout}


def packed(values: ArrayLike) -> dict[str, Any]:
    """Return numbers as Plotly's Base64 of single precision, which is half as long as text."""
    with np.errstate(over="ignore", invalid="ignore"):
        array = np.asarray(values, dtype="<f4")
    found: dict[str, Any] = {"dtype": "f4", "bdata": base64.b64encode(array.tobytes()).decode()}
    if array.ndim > 1:
        found["shape"] = ", ".join(map(str, array.shape))
    return found


def numbers(values: ArrayLike) -> list[Any]:
    """Return numbers as a list; what is not finite is None, a gap in a chart."""
    array = np.asarray(values, dtype=np.float64)
    return [None if not np.isfinite(value) else float(value) for value in array]


def words(text: str) -> str:
    """Return a text for a chart, where Plotly would read markup."""
    return html.escape(text, quote=False)


def colour(name: str) -> str:
    """Return a colour of a chart for the style sheet."""
    if name in charts.OUTCOMES:
        return charts.OUTCOMES[name].colour
    return name if name.startswith("#") else f"--{name}"


def _values(values: ArrayLike, axis: charts.Axis) -> Any:
    array = np.asarray(values, dtype=np.float64) * axis.factor
    return packed(array) if array.ndim == 1 and len(array) >= PACKED else numbers(array)


def _decades(chart: charts.Chart, name: str) -> float:
    """Return over how many decades the curves and maps of a chart extend along an axis."""
    drawn = (mark for mark in chart.marks if isinstance(mark, charts.Curve | charts.Grid))
    known = np.concatenate([np.zeros(0), *(np.ravel(getattr(mark, name)) for mark in drawn)])
    known = known[np.isfinite(known) & (known > 0.0)]
    return float(np.log10(known.max() / known.min())) if len(known) else 0.0


def _axis(chart: charts.Chart, name: str, axis: charts.Axis) -> dict[str, Any]:
    unit = axis.sign.strip("%")
    made: dict[str, Any] = {"title": {"text": words(axis.caption)}}
    if axis.scale == "names":
        made |= {"tickvals": list(range(len(axis.names))), "zeroline": False,
                 "ticktext": [words(each) for each in axis.names]}  # fmt: skip
    elif axis.scale == "log":
        made |= {"type": "log", "nticks": 4, "tickformat": "~s" if unit else "~g"}
        if CROWDED[0] <= _decades(chart, name) < CROWDED[1]:
            made["dtick"] = "D2"
        if unit:  # Plotly leaves a suffix out within a decade
            made["title"] = {"text": words(f"{axis.caption} ({unit})")}
    elif unit:
        made |= {"ticksuffix": unit, "tickformat": "~s", "hoverformat": ".5s"}
    if axis.whole:
        along = [getattr(mark, name, getattr(mark, "sizes", ())) for mark in chart.marks]
        largest = max(float(np.max(each, initial=0.0)) for each in map(np.asarray, along))
        made |= {"tickformat": "d"} | ({"dtick": 1} if largest <= FEW else {})
    if any(isinstance(mark, charts.Grid) for mark in chart.marks):
        made |= {"showgrid": False, "zeroline": False}
    if axis.limits is not None:
        ends = [_annotated(end, axis) for end in axis.limits]
        made["range"] = ends[::-1] if axis.reverse else ends
    elif axis.reverse:
        made["autorange"] = "reversed"
    return made


def _margin(chart: charts.Chart, texts: Sequence[dict[str, Any]]) -> dict[str, int]:
    beyond = [22 + LETTER * len(each["text"]) for each in texts if each["x"] == RIGHT]
    above = any(each["y"] == 1 and each.get("yref") == "paper" for each in texts)
    left = max([56.0, *(14 + LETTER * len(name) for name in chart.y.names)])
    return {"l": int(left), "r": int(max([14.0, *beyond])), "t": 30 if above else 24, "b": 44}


RIGHT = 1.005  # place of a text beyond the right edge, part of the width


def _hover(mark: charts.Curve, chart: charts.Chart) -> str:
    extra = f"<extra>{words(mark.name)}</extra>"
    if mark.hover:
        return "%{customdata}" + extra
    formats = {"%": "%{{{}:.4g}} %", "": "%{{{}:.5g}}"}
    parts = (
        formats.get(axis.sign, "%{{{}:.5s}}" + axis.sign).format(letter)
        for letter, axis in reversed(chart.axes)
    )
    return " at ".join(parts) + extra


def _curve(mark: charts.Curve, chart: charts.Chart) -> Iterator[dict[str, Any]]:
    look = colour(mark.colour)
    trace: dict[str, Any] = {
        "type": "scatter", "name": words(mark.name), "legendgroup": words(mark.name),
        "x": _values(mark.x, chart.x), "y": _values(mark.y, chart.y),
        "hovertemplate": _hover(mark, chart),
        "showlegend": bool(mark.name) and mark.label == "legend",
        "line": {"color": look, "width": mark.width, "dash": mark.line or "solid"},
        "marker": {"symbol": mark.mark or "circle", "size": mark.size * 1.4, "color": look,
                   "line": {"width": 1.5 if mark.mark == "line-ns" else 0, "color": look}},
    }  # fmt: skip
    if mark.mark.endswith("-open"):
        trace["marker"]["line"]["width"] = 1.6
    if mark.hover:
        trace["customdata"] = [words(text) for text in mark.hover]
    shown = {"lines": mark.line, "markers": mark.mark}
    yield trace | {"mode": "+".join(name for name, drawn in shown.items() if drawn)}


def _shape(mark: charts.Limit | charts.Band, chart: charts.Chart) -> dict[str, Any]:
    across, other = mark.across, "y" if mark.across == "x" else "x"
    axis: charts.Axis = getattr(chart, across)
    rest = {f"{other}ref": "paper", f"{other}0": 0, f"{other}1": 1,
            "showlegend": bool(mark.name), "name": words(mark.name)}  # fmt: skip
    if isinstance(mark, charts.Limit):
        value = axis.factor * mark.value
        look = {"color": colour(mark.colour), "width": max(1.5, mark.width), "dash": mark.line}
        return {"type": "line", f"{across}0": value, f"{across}1": value, "line": look, **rest}
    return {
        "type": "rect", f"{across}0": axis.factor * mark.low, f"{across}1": axis.factor * mark.high,
        "fillcolor": colour(mark.colour), "line": {"width": 0}, "layer": "below", **rest,
        "opacity": 0.15 if mark.colour in charts.OUTCOMES else 0.35,
    }  # fmt: skip


def _columns(mark: charts.Columns, chart: charts.Chart) -> Iterator[dict[str, Any]]:
    """Yield the columns of each outcome; Plotly warns of a list of colours beside patterns."""
    for look in dict.fromkeys(mark.looks):
        own = np.array([each == look for each in mark.looks])
        pattern = PATTERNS.get(charts.OUTCOMES[look].hatch, "/")
        yield {
            "type": "bar", "x": _values(np.asarray(mark.places)[own], chart.x),
            "y": _values(np.asarray(mark.sizes)[own], chart.y),
            "width": _values(np.asarray(mark.widths)[own], chart.x), "showlegend": False,
            "marker": {"color": colour(look), "pattern": HATCH | {"shape": pattern}},
            "hovertemplate": "%{y:.4g}<extra></extra>",
        }  # fmt: skip


def _grid(mark: charts.Grid, chart: charts.Chart) -> Iterator[dict[str, Any]]:
    values = np.asarray(mark.values, dtype=np.float64)
    places, labels = charts.levels(mark, values)
    ticks = {figure(value, mark.unit, 3): place for place, value in labels}
    texts = mark.texts or [[figure(each, mark.unit) for each in row] for row in values.tolist()]
    trace: dict[str, Any] = {
        "type": "heatmap", "x": _values(mark.x, chart.x), "y": _values(mark.y, chart.y),
        "z": [numbers(row) for row in places], "zmin": 0, "zmax": 1,
        "customdata": [[words(text) for text in row] for row in texts],
        "colorscale": SIGNED if mark.scale == "signed" else MAP,
        "showscale": True, "showlegend": False,
        "colorbar": {"thickness": 12, "outlinewidth": 0, "tickvals": [*ticks.values()],
                     "ticktext": [*ticks]},
        "hovertemplate": f"{words(chart.x.title)} %{{x}}, {words(chart.y.title)} %{{y}}:"
                         " %{customdata}<extra></extra>",
    }  # fmt: skip
    if mark.written:
        trace |= {"text": [[words(text) for text in row] for row in mark.written],
                  "texttemplate": "%{text}", "textfont": {"size": 11}}  # fmt: skip
    if values.size <= 4096:
        trace |= {"xgap": 1, "ygap": 1}
    yield trace


TRACES: dict[type, Callable[[Any, charts.Chart], Iterator[dict[str, Any]]]] = {
    charts.Curve: _curve,
    charts.Columns: _columns,
    charts.Grid: _grid,
}


SIDES = {"left": "right", "right": "left", "middle": "center"}
LEVELS = {"above": "bottom", "below": "top", "middle": "middle"}


def _text(mark: charts.Text, chart: charts.Chart) -> dict[str, Any]:
    side, level = mark.align
    made: dict[str, Any] = {
        "text": words(mark.text), "showarrow": False, "xanchor": SIDES[side],
        "yanchor": LEVELS[level], "font": {"size": 11, "color": colour(mark.colour)},
    }  # fmt: skip
    if mark.x is None:  # beyond the right edge, or in the left or right corner
        place = {"left": 1, "right": RIGHT if level == "middle" else 0, "middle": 0.5}[side]
        made |= {"xref": "paper", "x": place}
    else:
        made["x"] = _annotated(mark.x, chart.x)
    if mark.y is None:
        made |= {"yref": "paper", "y": {"above": 0, "below": 1, "middle": 0.5}[level]}
    else:
        made["y"] = _annotated(mark.y, chart.y)
    return made


def _annotated(value: float, axis: charts.Axis) -> float:
    value *= axis.factor
    return math.log10(value) if axis.scale == "log" and value > 0.0 else value
