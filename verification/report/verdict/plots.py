"""Pictures of a verdict. matplotlib is imported where it is used."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from netlist_gen.quantities import show
from spice_models.array_types import Floats
from spice_models.errors import Complaint, InputError
from verification.pipeline.agreement import Agreement
from verification.report.verdict.table import amount
from verification.verify import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".png", ".svg", ".pdf")
LEGEND_LIMIT = 12  # above, a colour bar would tell more than a legend; we leave both out
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
        The ending is none of `ENDINGS`, the folder is missing, or matplotlib is not installed.
    """
    file = Path(path)
    if file.suffix.lower() not in ENDINGS:
        text = f"expected a file that ends in {', '.join(ENDINGS)}"
        raise InputError("--plot", Complaint("FILE", repr(path), text))
    if not file.parent.is_dir():
        raise InputError("--plot", Complaint("FILE", repr(path), "its folder does not exist"))
    if importlib.util.find_spec("matplotlib") is None:
        text = "needs matplotlib: pip install 'taction[plot]'"
        raise InputError("--plot", Complaint("FILE", repr(path), text))


def plot_verdict(verdict: Verdict, path: str) -> None:
    """Draw outputs with targets and settling band, and the recovered stress beside the true one.

    Raises
    ------
    InputError
        See `check_plot_file`; or the file cannot be written.
    """
    check_plot_file(path)
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        two_engines = verdict.agreement is not None and not verdict.agreement.reason
        figure = Figure(figsize=(11, 9.2 if two_engines else 7.2), layout="constrained")
        FigureCanvasAgg(figure)
        heights = (1, 1, 0.55) if two_engines else (1, 1)
        grid = figure.add_gridspec(len(heights), 2, width_ratios=(1.7, 1), height_ratios=heights)
        _early(figure.add_subplot(grid[0, 0]), verdict)
        _settling(figure.add_subplot(grid[1, 0]), verdict)
        _stress(figure.add_subplot(grid[0, 1]), verdict)
        _summary(figure.add_subplot(grid[1, 1]), verdict)
        if verdict.agreement is not None and two_engines:
            _difference(figure.add_subplot(grid[2, 0]), verdict, verdict.agreement)
        figure.suptitle(f"{verdict.scene.name}: {verdict.outcome.value}", fontweight="bold")
        save(figure, path)


def save(figure: Figure, path: str) -> None:
    """Write `figure` to `path`, without a date, so that the same picture gives the same bytes.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(Path(path).suffix)
    try:
        figure.savefig(path, dpi=150, metadata=metadata)
    except OSError as error:
        text = f"{error.strerror}; expected a file that can be written"
        raise InputError("--plot", Complaint("FILE", repr(path), text)) from None


def time_unit(longest: float) -> tuple[float, str]:
    """Return the unit of a time axis that reaches to `longest` s: its length in s, its name."""
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
    """Draw ngspice minus the state-space engine, which is on the record above to line width."""
    size, name = time_unit(float(verdict.waveforms.time[-1]))
    scale = 100.0 / (verdict.measurements.amplitude or 1.0)
    columns = agreement.differences.T
    for colour, column in zip(_colours(len(columns)), columns, strict=True):
        axes.plot(agreement.instants / size, scale * column, color=colour, lw=0.5)
    end = verdict.waveforms.time[-1] / size
    axes.set(xlabel=f"time ({name})", ylabel="% of the step", xlim=(0, end))
    axes.set_title("ngspice (steps extrapolated) minus the state-space engine")


def _traces(axes: Axes, verdict: Verdict, end: float) -> None:
    t = verdict.waveforms.time
    size, name = time_unit(end)
    shown = t <= end
    channels = verdict.measurements.channels
    colours = _colours(len(channels))
    for channel, colour in zip(channels, colours, strict=True):
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
    if _drawable(final, reference):
        axes.plot(where, final, "x", color="C3", label="board, end of record")
    axes.set(xlabel=label, ylabel="stress", title="recovered stress")
    axes.legend(fontsize="small")


def _drawable(final: Floats, reference: Floats) -> bool:
    """Whether the board's end fits on the picture: a board that ran away would flatten it."""
    return bool(np.max(np.abs(final)) < 20 * (np.max(np.abs(reference)) + 1e-300))


def _summary(axes: Axes, verdict: Verdict) -> None:
    axes.axis("off")
    colours = {"pass": "C2", "fail": "C3", "inconclusive": "C1"}
    rows: list[tuple[str, str, str]] = []
    for check in verdict.checks:
        rows.append(
            (check.name.replace("_", " "), check.outcome.value, amount(check.value, check.unit))
        )
    table = axes.table(rows, colLabels=("check", "outcome", "value"), loc="upper left", edges="B")
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.scale(1, 1.5)
    for row, check in enumerate(verdict.checks, 1):
        table[row, 1].get_text().set_color(colours[check.outcome.value])


def _colours(count: int) -> list[Any]:
    from matplotlib import colormaps

    return [colormaps["viridis"](0.9 * k / max(count - 1, 1)) for k in range(count)]
