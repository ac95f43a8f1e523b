"""Axes of the pictures of a sweep: places, edges of cells, ticks with SI prefixes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taction.netlist_gen.scene.axes import Axis
from taction.system.array_types import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Ruler:
    """Positions (n,) of the values of an axis, and edges (n + 1,) of the cells around them.

    Numbers stand at their values; words and lists stand one after the other.
    """

    def __init__(self, axis: Axis) -> None:
        self.axis = axis
        self.by_value = axis.key.kind != "choice" and axis.scale != "list"
        self.log = self.by_value and axis.scale == "log"
        values = axis.values if self.by_value else range(len(axis))
        self.places: Floats = np.array([float(value) for value in values])
        inner = np.log(self.places) if self.log else self.places
        half = 0.5 * np.diff(inner) if len(inner) > 1 else np.array([0.5])
        ends = np.concatenate([[inner[0] - half[0]], inner[:-1] + half, [inner[-1] + half[-1]]])
        ends = ends if len(inner) > 1 else np.array([inner[0] - 0.5, inner[0] + 0.5])
        self.edges: Floats = np.exp(ends) if self.log else ends

    def mark(self, axes: Axes, which: str) -> None:
        """Set scale, label and ticks of the x or the y axis."""
        label: dict[str, Any] = {f"{which}label": self.axis.name}
        if self.log:
            label[f"{which}scale"] = "log"
        axes.set(**label)
        if self.by_value:
            ruler = axes.xaxis if which == "x" else axes.yaxis
            tick(ruler, self.axis.key.unit, self.edges[0], self.edges[-1] if self.log else 0.0)
        else:
            write = prefixes(self.axis.key.unit)
            names = [write(v) if isinstance(v, float) else str(v) for v in self.axis.values]
            (axes.set_xticks if which == "x" else axes.set_yticks)(self.places, names)


def tick(ruler: Any, unit: str, low: float, high: float) -> None:
    """Write values with SI prefixes, at 1, 2 and 5 of each decade if there are few decades."""
    from matplotlib.ticker import LogLocator, NullFormatter

    ruler.set_major_formatter(prefixes(unit))
    if high > 0.0:
        short = high < 300.0 * low
        ruler.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if short else (1.0,)))
        ruler.set_minor_formatter(NullFormatter())


def prefixes(unit: str) -> Any:
    """Return a formatter of values with SI prefixes and a unit."""
    from matplotlib.ticker import EngFormatter, StrMethodFormatter

    return EngFormatter(unit.replace("ohm", "Ω")) if unit else StrMethodFormatter("{x:g}")
