"""The picture of a yield: histograms with their limits, and the components behind the spread."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taction.system.array_types import Floats
from taction.verification.report.picture import BLUE, HATCHES, ORANGE, figure_file
from taction.verification.report.tables import spaced, value_text
from taction.verification.studies.tolerance.varied_board import BoardSample
from taction.verification.studies.tolerance.yield_report import Spread, YieldReport

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BINS = 40  # at most
CULPRITS = 8  # components of the picture
ACROSS = 3  # panels side by side
SIZE = (4.3, 2.9)  # of a panel, inches
FAR = 1.5  # times the range of the values: a limit farther away is an arrow
TALL = 1.1  # height of the axes over the highest bar
SAME = 1e-9  # relative: values that are one value


def plot_yield(
    name: str,
    report: YieldReport,
    samples: Sequence[BoardSample],
    path: str | Path | None = None,
) -> Figure:
    """Draw a histogram of every quantity with its limits, and the largest correlations.

    Parameters
    ----------
    name : str
        Of the scene, for the title.
    samples : sequence of BoardSample
        The samples that `report` summarises.
    path : path, optional
        Write the figure into this file.

    Raises
    ------
    InputError
        See `taction.verification.report.picture.figure_file`.
    """
    drawn = [
        (spread, values) for spread in report.quantities if len(values := _of(spread, samples))
    ]
    panels = len(drawn) + 1
    rows, columns = -(-panels // ACROSS), min(panels, ACROSS)
    low, high = (f"{100 * share:.3g} %" for share in (report.low, report.high))
    title = (
        f"{name}: {report.passed} of {report.samples} boards pass, yield"
        f" {100 * report.fraction:.3g} %, 95 % interval {low} to {high}"
        if report.samples
        else f"{name}: no sample"
    )
    with figure_file(path, SIZE[0] * columns, SIZE[1] * rows + 0.5, title) as figure:
        grid = figure.add_gridspec(rows, columns)
        for place, (spread, values) in enumerate(drawn):
            _histogram(figure.add_subplot(grid[divmod(place, columns)]), spread, values)
        _culprits(figure.add_subplot(grid[divmod(panels - 1, columns)]), report)
        if report.remedy is not None and report.remedy.what:
            remedy, share = report.remedy, f"{100 * report.remedy.fraction:.3g} %"
            figure.supxlabel(f"{remedy.what}: yield {share}", fontsize="medium")
    return figure


def _of(spread: Spread, samples: Sequence[BoardSample]) -> Floats:
    """Return the finite values of a quantity."""
    found = [sample.value(spread.name) for sample in samples]
    values = np.array([math.nan if value is None else value for value in found], dtype=np.float64)
    return np.asarray(values[np.isfinite(values)])


def _histogram(axes: Axes, spread: Spread, values: Floats) -> None:
    """Draw the samples within the limits, and hatched those beyond them."""
    limits = [limit for limit in (spread.at_least, spread.at_most) if limit is not None]
    least, most = spread.at_least, spread.at_most
    beyond = np.zeros(len(values), dtype=np.bool_)
    if least is not None:
        beyond |= values < least
    if most is not None:
        beyond |= values > most
    text = ", ".join(value_text(limit, spread.unit, 3) for limit in limits)
    share = f"{100 * beyond.mean():.3g} % beyond {text}" if limits else "no limit"
    axes.set_title(f"{spaced(spread.name)}: {share}", fontsize=9)
    if float(np.ptp(values)) <= SAME * float(np.abs(values).max()):
        same = value_text(float(values[0]), spread.unit, 3)
        axes.text(0.5, 0.5, f"every sample: {same}", ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    factor = 0.01 if spread.unit == "step" else 1.0
    edges = _edges(values / factor, [limit / factor for limit in limits])
    groups = ((values[~beyond], BLUE, "pass"), (values[beyond], ORANGE, "fail"))
    bottom = np.zeros(len(edges) - 1)
    for group, colour, outcome in groups:
        counts, _ = np.histogram(group / factor, bins=edges)
        axes.bar(
            edges[:-1], counts, np.diff(edges), bottom, align="edge", color=colour,
            edgecolor="white", linewidth=0.4, hatch=HATCHES[outcome],
        )  # fmt: skip
        bottom += counts
    axes.set_ylim(0.0, TALL * float(bottom.max()))
    _limits(axes, edges, [limit / factor for limit in limits])
    _ticks(axes, spread.unit)


def _edges(values: Floats, limits: list[float]) -> Floats:
    """Return the edges of the bins; a limit among the values is an edge."""
    edges = np.histogram_bin_edges(values, bins=min(BINS, 4 + math.isqrt(len(values))))
    inside = [limit for limit in limits if edges[0] < limit < edges[-1]]
    if not inside:
        return np.asarray(edges, dtype=np.float64)
    width = float(edges[1] - edges[0])
    before = math.ceil((inside[0] - edges[0]) / width)
    after = math.ceil((edges[-1] - inside[0]) / width)
    return np.asarray(inside[0] + width * np.arange(-before, after + 1))


def _limits(axes: Axes, edges: Floats, limits: list[float]) -> None:
    """Draw the limits that are near the samples, and an arrow towards those that are far."""
    low, high = float(edges[0]), float(edges[-1])
    reach = FAR * (high - low)
    near = [limit for limit in limits if low - reach <= limit <= high + reach]
    for limit in near:
        axes.axvline(limit, color="black", ls="--", lw=1.2)
    ends = min([low, *near]), max([high, *near])
    room = 0.04 * (ends[1] - ends[0])
    axes.set_xlim(ends[0] - room, ends[1] + room)
    for limit in limits:
        if limit not in near:
            place, align = (0.98, "right") if limit > high else (0.02, "left")
            arrow = "limit →" if limit > high else "← limit"
            axes.text(place, 0.92, arrow, ha=align, transform=axes.transAxes, fontsize=8)


def _ticks(axes: Axes, unit: str) -> None:
    from matplotlib.ticker import EngFormatter, MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    if unit in ("step", "ratio"):
        axes.xaxis.set_major_formatter("{x:.3g}")
    else:
        axes.xaxis.set_major_formatter(EngFormatter("/s" if unit == "1/s" else unit))
    axes.set(xlabel="% of the step" if unit == "step" else "", ylabel="samples")


def _culprits(axes: Axes, report: YieldReport) -> None:
    """Draw the components with the largest shares of a variance."""
    axes.grid(visible=False, axis="y")
    shown = report.sensitivities[:CULPRITS]
    axes.set_title("components behind the spread", fontsize=9)
    if not shown:
        axes.text(0.5, 0.5, "none stands out", ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    names = [f"{item.parameter}, {spaced(item.quantity)}" for item in shown]
    shares = [100.0 * item.correlation**2 for item in shown]
    bars = axes.barh(range(len(shown)), shares, color=BLUE, edgecolor="white")
    for item, bar in zip(shown, bars, strict=True):
        if item.correlation < 0.0:
            bar.set(facecolor=ORANGE, edgecolor="white", hatch=HATCHES["fail"])
    axes.set_yticks(range(len(shown)), names, fontsize=7)
    axes.invert_yaxis()
    for place, (item, share) in enumerate(zip(shown, shares, strict=True)):
        sign = "+" if item.correlation > 0.0 else "−"
        axes.annotate(f" {sign} {share:.0f} %", (share, place), va="center", fontsize=7)
    axes.set_xlim(0.0, 1.25 * max(shares))
    axes.set_xlabel("of the variance (%)\n− and hatched: falls with the part")
