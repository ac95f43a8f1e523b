"""Parts of the specifications of pictures: numbers, colours, axes and texts for Plotly."""

from __future__ import annotations

import base64
import html
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taction.system.array_types import Floats

# One lightness between the two papers: at least 3 to 1 against white and against the dark page.
SERIES = ("#2f7fc1", "#c4661f", "#7d6bc4", "#2b8f8f", "#a8628f", "#8a7a2a", "#5c7a9a", "#b8574d")
SIGNS = {"ohm": "Ω"}
HATCH = {"shape": "/", "fgcolor": "--fail-fill", "bgcolor": "--fail-soft", "fillmode": "overlay"}
DASHES = ("solid", "dash", "dot", "dashdot")
LABELS = ((1.0, "D1"), (2.5, "D2"))  # decades up to which an axis has labels at these digits
SPREAD = ((47, 127, 193), (125, 107, 196), (168, 98, 143), (196, 102, 31))
MARKS = ("circle", "x", "diamond", "square-open", "triangle-up", "star", "cross", "triangle-down")
OUTCOMES = {
    "pass": ("--pass", "circle"),
    "fail": ("--fail", "x"),
    "inconclusive": ("--unsure", "square-open"),
    "error": ("--muted", "triangle-up-open"),
}


def packed(values: ArrayLike) -> dict[str, Any]:
    """Return numbers as Plotly's Base64 of single precision, which is half as long as text.

    Examples
    --------
    >>> packed([0.0, 1.0])
    {'dtype': 'f4', 'bdata': 'AAAAAAAAgD8='}
    """
    with np.errstate(over="ignore", invalid="ignore"):
        array = np.asarray(values, dtype="<f4")
    found: dict[str, Any] = {"dtype": "f4", "bdata": base64.b64encode(array.tobytes()).decode()}
    if array.ndim > 1:
        found["shape"] = ", ".join(map(str, array.shape))
    return found


def numbers(values: ArrayLike) -> list[Any]:
    """Return numbers as a list; what is not finite is None, a gap in a picture."""
    array = np.asarray(values, dtype=np.float64)
    return [None if not np.isfinite(value) else float(value) for value in array]


def words(text: str) -> str:
    """Return a text for a picture, where Plotly would read markup."""
    return html.escape(text, quote=False)


def axis(title: str, unit: str = "", **more: Any) -> dict[str, Any]:
    """Return an axis; with a `unit`, its numbers have SI prefixes and the unit."""
    made: dict[str, Any] = {"title": {"text": words(title)}, **more}
    if unit:
        made |= {"ticksuffix": SIGNS.get(unit, unit), "tickformat": "~s", "hoverformat": ".5s"}
    return made


def log_axis(title: str, unit: str, values: ArrayLike) -> dict[str, Any]:
    """Return a logarithmic axis over positive `values`; a short one is labelled in each decade.

    The unit is in the title, since Plotly leaves it out of the labels within a decade.
    """
    array = np.asarray(values, dtype=np.float64)
    known = array[np.isfinite(array) & (array > 0.0)]
    decades = float(np.log10(known.max() / known.min())) if len(known) else 0.0
    step = next((name for end, name in LABELS if decades < end), 1)
    shown = f"{title} ({SIGNS.get(unit, unit)})" if unit.strip() else title
    return axis(shown, type="log", dtick=step, tickformat="~s")


def channel_colours(count: int) -> list[str]:
    """Return a colour for each channel, from blue over violet to orange."""
    places = np.linspace(0.0, len(SPREAD) - 1.0, count) if count > 1 else np.zeros(1)
    levels = np.arange(len(SPREAD))
    rgb = [np.interp(places, levels, np.array(SPREAD)[:, k]) for k in range(3)]
    return ["rgb({:.0f},{:.0f},{:.0f})".format(*each) for each in zip(*rgb, strict=True)]


def line(x: float | None, y: float | None, colour: str = "--ink", **more: Any) -> dict[str, Any]:
    """Return a straight line over the whole picture, at the place `x` or at the height `y`."""
    across: dict[str, Any] = {"type": "line", "line": {"color": colour, "width": 1.5, **more}}
    if x is not None:
        return across | {"x0": x, "x1": x, "yref": "paper", "y0": 0, "y1": 1}
    return across | {"y0": y, "y1": y, "xref": "paper", "x0": 0, "x1": 1}


def area(low: float, high: float, *, across: str, colour: str, **more: Any) -> dict[str, Any]:
    """Return a shaded part of the picture between two values of the axis ``"x"`` or ``"y"``."""
    other = "y" if across == "x" else "x"
    place = {f"{across}0": low, f"{across}1": high, f"{other}ref": "paper"}
    rest = {f"{other}0": 0, f"{other}1": 1, "line": {"width": 0}, "layer": "below"}
    return {"type": "rect", "fillcolor": colour, "opacity": 0.35, **place, **rest, **more}


def label(text: str, x: Any, y: Any, **more: Any) -> dict[str, Any]:
    """Return a text beside a place of the picture."""
    plain = {"showarrow": False, "font": {"size": 11, "color": "--muted"}}
    return {"text": words(text), "x": x, "y": y, **plain, **more}


def thinned(time: Floats, values: Floats, budget: int) -> tuple[Floats, Floats]:
    """Return at most about `budget` points of a curve with the extremes of every part of it.

    Parameters
    ----------
    time, values : ndarray (P,)
        The curve.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 10001)
    >>> _, shown = thinned(t, np.where(t == 0.5, 9.0, 0.0), 100)
    >>> len(shown) <= 102, float(shown.max())
    (True, 9.0)
    """
    size = -(-2 * len(time) // max(budget, 2))
    if size <= 2:
        return time, values
    whole = len(time) // size * size
    parts = values[:whole].reshape(-1, size)
    first = np.arange(0, whole, size)
    places = [first + parts.argmin(axis=1), first + parts.argmax(axis=1)]
    kept = np.unique(np.concatenate([[0], *places, [len(time) - 1]]))
    return time[kept], values[kept]
