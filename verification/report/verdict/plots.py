"""Pictures of a verdict. matplotlib is imported where it is used."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from netlist_gen.quantities import show
from spice_models.atomic_files import replacing
from verification.pipeline.agreement import Agreement
from verification.report.output_checks import check_file
from verification.report.tables import spaced
from verification.report.verdict.table import amount
from verification.verify import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MATPLOTLIB = ("matplotlib", "needs matplotlib: pip install 'taction[plot]'")
PACKAGES = dict.fromkeys((".png", ".svg", ".pdf"), MATPLOTLIB)
METADATA = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
LEGEND_LIMIT = 12  # channels above which there is no legend
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))
STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "taction",  # the same picture gives the same bytes
}


def check_plot_file(path: str) -> None:
    """Refuse a picture that could not be drawn, before any work is done.

    Raises
    ------
    InputError
        The ending is not in `PACKAGES`, the folder is missing, or matplotlib is not installed.
    """
    check_file(path, "--plot", PACKAGES, PACKAGES)


@contextmanager
def new_figure(width: float, height: float) -> Iterator[Figure]:
    """Give a figure of `width` by `height` inches in the style of all pictures."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


@contextmanager
def figure_file(path: str, width: float, height: float, title: str = "") -> Iterator[Figure]:
    """Give a `new_figure` and write the finished picture to `path`, always with the same bytes.

    Raises
    ------
    InputError
        See `check_plot_file`; or the file cannot be written.
    """
    check_plot_file(path)
    with new_figure(width, height) as figure:
        if title:
            figure.suptitle(title, fontweight="bold")
        yield figure
        with replacing(path) as file:
            figure.savefig(file, dpi=150, metadata=METADATA.get(Path(path).suffix.lower()))


def plot_verdict(verdict: Verdict, path: str) -> None:
    """Draw outputs with targets and settling band, and the recovered stress beside the true one.

    Raises
    ------
    InputError
        See `figure_file`.
    """
    agreement = verdict.agreement
    compared = agreement is not None and not agreement.reason
    heights = (1, 1, 0.55) if compared else (1, 1)
    title = f"{verdict.scene.name}: {verdict.outcome.value}"
    with figure_file(path, 11, 9.2 if compared else 7.2, title) as figure:
        grid = figure.add_gridspec(len(heights), 2, width_ratios=(1.7, 1), height_ratios=heights)
        _early(figure.add_subplot(grid[0, 0]), verdict)
        _settling(figure.add_subplot(grid[1, 0]), verdict)
        _stress(figure.add_subplot(grid[0, 1]), verdict)
        _summary(figure.add_subplot(grid[1, 1]), verdict)
        if agreement is not None and compared:
            _difference(figure.add_subplot(grid[2, 0]), verdict, agreement)


def time_unit(longest: float) -> tuple[float, str]:
    """Return the unit of a time axis up to `longest`, s: its length in s, and its name."""
    return next(((size, name) for size, name in UNITS if longest >= size), UNITS[-1])


def _early(axes: Axes, verdict: Verdict) -> None:
    """Draw the first rise: ten times the longest rise time."""
    rises = [c.rise_time.value for c in verdict.measurements.channels if c.rise_time is not None]
    end = min(10 * max(rises, default=verdict.transient.stop), verdict.transient.stop)
    _traces(axes, verdict, end)
    axes.set_title("outputs, first rise")
    if len(verdict.measurements.channels) <= LEGEND_LIMIT:
        axes.legend(fontsize="small", ncols=2, loc="best")


def _settling(axes: Axes, verdict: Verdict) -> None:
    """Draw the whole record as deviation from the target, with the settling band."""
    t, m = verdict.waveforms.time, verdict.measurements
    size, name = time_unit(float(t[-1]))
    scale = 100.0 / (m.amplitude or 1.0)
    targets = np.array([c.target for c in m.channels])
    for colour, column in zip(_colours(len(targets)), (verdict.u - targets).T, strict=True):
        axes.plot(t / size, scale * column, color=colour, lw=0.6)
    band = 100 * m.band
    axes.axhspan(-band, band, color="0.85", zorder=0, label=f"±{band:g} % band")
    if m.settling_time is not None:
        label = f"settled at {show(m.settling_time.value, 's')}"
        axes.axvline(m.settling_time.value / size, color="k", ls="--", lw=1, label=label)
    if m.settling_time is not None and verdict.outcome.value != "inconclusive":
        axes.set_ylim(-6 * band, 6 * band)
    axes.set(xlabel=f"time ({name})", ylabel="deviation (% of the step)", xlim=(0, t[-1] / size))
    axes.set_title("deviation from the reference")
    axes.legend(fontsize="small", loc="upper right")


def _difference(axes: Axes, verdict: Verdict, agreement: Agreement) -> None:
    """Draw ngspice minus the state-space engine; in the record above the two lines coincide."""
    size, name = time_unit(float(verdict.waveforms.time[-1]))
    scale = 100.0 / (verdict.measurements.amplitude or 1.0)
    columns = agreement.differences.T
    for colour, column in zip(_colours(len(columns)), columns, strict=True):
        axes.plot(agreement.instants / size, scale * column, color=colour, lw=0.5)
    end = verdict.waveforms.time[-1] / size
    axes.set(xlabel=f"time ({name})", ylabel="% of the step", xlim=(0, end))
    axes.set_title("ngspice minus the state-space engine")


def _traces(axes: Axes, verdict: Verdict, end: float) -> None:
    t = verdict.waveforms.time
    size, name = time_unit(end)
    shown = t <= end
    channels = verdict.measurements.channels
    for channel, colour in zip(channels, _colours(len(channels)), strict=True):
        label = f"$u_{{{channel.index + 1}}}$"
        axes.plot(t[shown] / size, verdict.u[shown, channel.index], color=colour, label=label, lw=1)
        axes.axhline(channel.target, color=colour, ls=":", lw=0.8)
    axes.set(xlabel=f"time ({name})", ylabel="output (V); dotted: reference", xlim=(0, end / size))


def _stress(axes: Axes, verdict: Verdict) -> None:
    problem, U0 = verdict.problem, verdict.circuit.scalings.unit_voltage
    channels = verdict.measurements.channels
    if problem.positions is None:
        where, label = np.arange(1.0, len(channels) + 1), "channel"
    else:
        where, label = problem.positions, "y (in depths)"
        where = where / getattr(verdict.scene.problem, "depth", 1.0)
    if problem.stress is not None:
        axes.plot(where, problem.stress, "o-", color="0.6", label="true stress")
    reference = np.array([c.target for c in channels]) / U0
    axes.plot(where, reference, "s-", mfc="none", color="C0", label="regularised optimum")
    final = np.array([c.final for c in channels]) / U0
    if np.max(np.abs(final)) < 20 * (np.max(np.abs(reference)) + 1e-300):  # else off the scale
        axes.plot(where, final, "x", color="C3", label="board, end of record")
    axes.set(xlabel=label, ylabel="stress", title="recovered stress")
    axes.legend(fontsize="small")


def _summary(axes: Axes, verdict: Verdict) -> None:
    axes.axis("off")
    colours = {"pass": "C2", "fail": "C3", "inconclusive": "C1"}
    rows = [(spaced(c.name), c.outcome.value, amount(c.value, c.unit)) for c in verdict.checks]
    table = axes.table(rows, colLabels=("check", "outcome", "value"), loc="upper left", edges="B")
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.scale(1, 1.5)
    for row, check in enumerate(verdict.checks, 1):
        table[row, 1].get_text().set_color(colours[check.outcome.value])


def _colours(count: int) -> list[Any]:
    from matplotlib import colormaps

    return [colormaps["viridis"](0.9 * k / max(count - 1, 1)) for k in range(count)]
