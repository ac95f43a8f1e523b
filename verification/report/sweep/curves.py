"""Curves of a sweep over one axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taction.netlist_gen.scene.axes import Axis
from taction.verification.report.picture import BLUE, ORANGE
from taction.verification.report.sweep.panels import (
    ENGINES,
    LITTLE,
    PANELS,
    kinds_of,
    linear_part,
    rate_ticks,
)
from taction.verification.report.sweep.rulers import Ruler, prefixes, tick

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINES = {"ngspice": ("o", ORANGE, 7.0), "statespace": ("-", BLUE, 4.0)}
OTHER_LINE = ("s", ORANGE, 5.0)  # of an engine of another package
MARKERS = "oxs^vD*P"


def draw_curves(
    figure: Figure,
    axis: Axis,
    data: dict[str, Any],
    names: np.ndarray[Any, Any],
    engines: tuple[str, ...],
) -> None:
    """Draw the figures of `PANELS` and what fails over one axis."""
    panels = figure.subplots(2, 3, sharex=True)
    ruler = Ruler(axis)
    unstable = np.nanmax(data["growth_rate"], axis=-1, initial=-np.inf) > 0.0
    for axes, quantity in zip(panels.flat, PANELS, strict=False):
        if quantity.is_rounding(quantity.factor * data[quantity.name]):
            axes.set(title=quantity.title, yticks=())
            axes.text(0.5, 0.5, LITTLE, transform=axes.transAxes, ha="center")
            continue
        for k, engine in enumerate(engines):
            style, colour, size = LINES.get(engine, OTHER_LINE)
            values = quantity.factor * data[quantity.name][..., k]
            style = style if len(ruler.places) > 1 and ruler.by_value else "o"
            axes.plot(
                ruler.places,
                values,
                style,
                color=colour,
                ms=size,
                mfc="none",
                label=ENGINES[engine],
            )
        axes.set_title(quantity.title)
        if quantity.scale == "symlog":
            largest = float(np.nanmax(np.abs(data[quantity.name]), initial=1.0))
            axes.set_yscale("symlog", linthresh=linear_part(largest))
            axes.set_yticks(rate_ticks(largest))
            axes.yaxis.set_major_formatter(prefixes("/s"))
            axes.axhline(0.0, color="k", lw=1.0)
        elif quantity.scale == "log" and np.isfinite(data[quantity.name]).any():
            axes.set_yscale("log")
            values = quantity.factor * data[quantity.name]
            ends = (float(limit(values)) for limit in (np.nanmin, np.nanmax))
            tick(axes.yaxis, quantity.unit, *ends)
    _strip(panels.flat[-1], names, ruler, engines)
    for axes in panels.flat:
        ruler.mark(axes, "x")
        for left, right in zip(ruler.edges[:-1][unstable], ruler.edges[1:][unstable], strict=True):
            axes.axvspan(left, right, fc="none", ec=ORANGE, hatch="//", alpha=0.4, lw=0.0, zorder=0)
    panels.flat[0].legend(fontsize="small")
    figure.supxlabel("hatched: unstable by its poles", fontsize="small")


def _strip(axes: Axes, names: np.ndarray[Any, Any], ruler: Ruler, engines: tuple[str, ...]) -> None:
    kinds = kinds_of(names.ravel().tolist())
    for place, kind in enumerate(kinds):
        rows, columns = np.nonzero(names == kind.name)
        places, mark = ruler.places[rows], MARKERS[place % len(MARKERS)]
        axes.scatter(places, columns, 30, c=kind.colour, marker=mark, label=kind.name)
    axes.set(title="outcome", ylim=(-0.6, len(engines) - 0.4))
    axes.set_yticks(range(len(engines)), [ENGINES[engine] for engine in engines])
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
