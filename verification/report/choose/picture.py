"""Picture of a choice: for each op-amp a map of C and gain, coloured by the worst share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taction.system.quantities import readable, show
from taction.verification.design.choose_ranking import Design
from taction.verification.design.choose_request import CAPACITANCE, GAIN
from taction.verification.report.choose.tables import first_of_each, number
from taction.verification.report.picture import BLUE, ORANGE, check_plot_file, figure_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANELS, ACROSS = 9, 3
LOW, HIGH = 0.1, 10.0  # ends of the colours: shares of a limit
MAP = (BLUE, "#f4f4f2", ORANGE)  # within all limits, at one, beyond
MOST_TICKS = 5


def plot_choice(designs: Sequence[Design], best: Sequence[Design], title: str, path: str) -> None:
    """Draw maps of the best op-amps; a dot is a design that passes, a star one of the best.

    Raises
    ------
    InputError
        See `taction.verification.report.picture.figure_file`.
    """
    check_plot_file(path)
    names = [design.opamp for design in first_of_each(designs)][:PANELS]
    rows = math.ceil(len(names) / ACROSS)
    columns = min(len(names), ACROSS)
    with figure_file(path, 2.0 + 3.6 * columns, 1.4 + 3.0 * rows, title) as figure:
        panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
        image: Any = None
        for axes, name in zip(panels, names, strict=False):
            image = _panel(axes, [d for d in designs if d.opamp == name], best, name)
        for axes in panels[len(names) :]:
            axes.set_axis_off()
        bar = figure.colorbar(image, ax=panels.tolist(), extend="both", shrink=0.9)
        bar.set_label("worst value over its limit; blue: within all limits, orange: beyond one")
        bar.ax.axhline(1.0, color="k", lw=1.5)
        text = "dot: passes all checks, with parts that can be bought; star: among the best;"
        text += " grey: unstable or without a verdict"
        figure.supxlabel(text, fontsize="small")


def _panel(axes: Axes, own: Sequence[Design], best: Sequence[Design], name: str) -> Any:
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    farads = sorted({number(design.values[CAPACITANCE]) for design in own})
    ohms = sorted({number(design.values[GAIN]) for design in own})
    values = np.full((len(ohms), len(farads)), np.nan)
    chosen = {design.place for design in best}
    for design in own:
        x = farads.index(number(design.values[CAPACITANCE]))
        y = ohms.index(number(design.values[GAIN]))
        if math.isfinite(design.worst) and design.headroom is not None:
            values[y, x] = max(design.worst, LOW / 10.0)
        if design.place in chosen:
            axes.plot(x, y, "*", ms=15, mfc="w", mec="k", mew=1.2, zorder=3)
        elif design.good:
            axes.plot(x, y, "o", ms=4.5, mfc="w", mec="k", mew=0.8)
    axes.set_facecolor("0.8")
    shown = np.ma.masked_invalid(values)
    colours = LinearSegmentedColormap.from_list("share", MAP)
    norm = LogNorm(LOW, HIGH)
    image = axes.imshow(shown, origin="lower", aspect="auto", cmap=colours, norm=norm)
    passing = sum(design.good for design in own)
    axes.set_title(f"{name}: {passing} of {len(own)} pass", fontsize="medium")
    axes.set(xlabel="C", ylabel="gain")
    for axis, ticks, unit in ((axes.xaxis, farads, "F"), (axes.yaxis, ohms, "ohm")):
        step = math.ceil(len(ticks) / MOST_TICKS)
        axis.set_ticks(range(0, len(ticks), step))
        axis.set_ticklabels(
            [readable(show(value, unit, 3)) for value in ticks[::step]], fontsize="small"
        )
    axes.grid(visible=False)
    return image
