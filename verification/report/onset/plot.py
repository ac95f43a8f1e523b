"""Picture of an onset: the pole map with damping lines, and the root locus over the value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spice_models.array_types import Floats
from verification.report.verdict.plots import STYLE, check_plot_file, save
from verification.studies.onset.onset import Onset
from verification.studies.onset.scan_result import Sample

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

DAMPING = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7)
LABEL_ROOM = 0.1  # of the pole map's width: what the label of a damping line takes
HEADROOM = 1.25
SHORT = 15.0  # ratio of its ends below which a logarithmic axis shows too few decades
SHOWN = 0.5  # damping ratio up to which a mode is on the pictures
NEAR = 6  # modes of each sample, nearest the axis, that decide how far the pictures reach


def plot_onset(found: Onset, path: str) -> None:
    """Draw the poles of every value in the complex plane, and damping and frequency over it.

    Raises
    ------
    InputError
        See `verification.report.verdict.plots.check_plot_file`; or the file cannot be written.
    """
    check_plot_file(path)
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    samples = [sample for sample in found.scan.samples if not sample.failure]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.5, 6.4), layout="constrained")
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1))
        _pole_map(figure, figure.add_subplot(grid[:, 0]), found, samples)
        damping = figure.add_subplot(grid[0, 1])
        _damping(damping, found, samples)
        _frequency(figure.add_subplot(grid[1, 1], sharex=damping), found, samples)
        damping.tick_params(which="both", labelbottom=False)
        figure.suptitle(f"{found.scene.name}: poles over {found.axis.name}", fontweight="bold")
        save(figure, path)


def _points(samples: Sequence[Sample]) -> tuple[Floats, Floats, Floats]:
    """Value, real and imaginary part of every ringing pole with a positive frequency."""
    rows = [
        (sample.value, p.real, p.imag)
        for sample in samples
        for p in sample.poles[sample.poles.imag > 0.0].tolist()
        if -p.real < SHOWN * abs(p)
    ]
    value, real, imag = np.array(rows or np.zeros((0, 3))).T
    return value, real, imag


def _window(found: Onset, samples: Sequence[Sample]) -> tuple[float, float, float]:
    """Left, right and upper limit of the pole map, 1/s: what the modes that matter need."""
    near = [
        p
        for sample in samples
        for p in sample.poles[(sample.poles.imag > 0.0) & np.isfinite(sample.poles.real)][
            :NEAR
        ].tolist()
        if abs(p.real) < SHOWN * abs(p)
    ]
    ringing = [each.crossing for each in found.findings if each.crossing.frequency]
    decisive = [crossing for crossing in ringing if crossing.changes_stability]
    omega = [abs(crossing.pole) for crossing in decisive or ringing]
    top = HEADROOM * max(omega or [p.imag for p in near] or [1.0])
    real = [p.real for p in near if p.imag < top] or [-top, top]
    left, right = np.percentile(real, (5, 95)).tolist()
    least = max(0.25 * (right - left), 1e-4 * top)
    return min(HEADROOM * left, -least), max(HEADROOM * right, least), top


def _pole_map(figure: Figure, axes: Axes, found: Onset, samples: Sequence[Sample]) -> None:
    from matplotlib.colors import LogNorm, Normalize

    left, right, top = _window(found, samples)
    value, real, imag = _points(samples)
    size, unit = _scale(top)
    norm = (LogNorm if found.scan.logarithmic else Normalize)(samples[0].value, samples[-1].value)
    _damping_lines(axes, left, right, top, size)
    axes.axvline(0.0, color="k", lw=1)
    axes.axvspan(0.0, right / size, color="C3", alpha=0.06, lw=0)
    dots = axes.scatter(real / size, imag / size, c=value, s=9, norm=norm, cmap="viridis", zorder=3)
    for each in found.findings:
        axes.plot(0.0, each.crossing.pole.imag / size, "o", mfc="none", mec="C3", ms=9, zorder=4)
    axes.set(xlim=(left / size, right / size), ylim=(0.0, top / size), title="pole map")
    axes.set(xlabel=f"real part ({unit}/s)", ylabel=f"imaginary part ({unit}rad/s)")
    label = found.axis.name + (f" ({found.axis.key.unit})" if found.axis.key.unit else "")
    bar = figure.colorbar(dots, ax=axes, location="bottom", aspect=50, pad=0.01)
    _engineering(bar.ax.xaxis, "", samples[0].value, samples[-1].value)
    bar.set_label(label)


def _scale(largest: float) -> tuple[float, str]:
    for size, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if largest >= size:
            return size, prefix
    return 1.0, ""


def _damping_lines(axes: Axes, left: float, right: float, top: float, size: float) -> None:
    """Draw rays of equal damping ratio, those that leave through the upper edge."""
    inside = [zeta for zeta in DAMPING if zeta / math.sqrt(1.0 - zeta**2) * top < 0.95 * -left]
    last = -math.inf
    for zeta in inside[::-1]:
        x = -zeta / math.sqrt(1.0 - zeta**2) * top / size
        if x - last < LABEL_ROOM * (right - left) / size or -x < LABEL_ROOM * (right - left) / size:
            continue
        last = x
        axes.plot((0.0, x), (0.0, top / size), color="0.6", lw=0.7, ls="--", zorder=1)
        axes.annotate(
            f"ζ = {zeta:g}",
            (x, top / size),
            xytext=(0, -3),
            textcoords="offset points",
            ha="left",
            va="top",
            fontsize="x-small",
            color="0.4",
        )


def _engineering(axis: Axis, unit: str, low: float, high: float) -> None:
    """Label an axis with SI prefixes; a logarithmic one between its decades too if it is short."""
    from matplotlib.ticker import EngFormatter, NullFormatter

    short = low > 0.0 and high < SHORT * low
    axis.set_major_formatter(EngFormatter(unit=unit))
    axis.set_minor_formatter(EngFormatter(unit=unit) if short else NullFormatter())


def _over(axes: Axes, found: Onset) -> None:
    """Set up an axis over the swept value, with crossings and stable ranges on it."""
    if found.scan.logarithmic:
        axes.set_xscale("log")
    unit = found.axis.key.unit
    low, high = found.scan.samples[0].value, found.scan.samples[-1].value
    _engineering(axes.xaxis, unit, low, high)
    axes.set_xlim(low, high)
    for low, high in found.scan.stable_ranges:
        axes.axvspan(low, high, color="C2", alpha=0.08, lw=0)
    for each in found.findings:
        colour = {True: "C2", False: "C3", None: "C1"}[each.confirmation.confirmed]
        axes.axvline(each.crossing.value, color=colour, lw=1, ls="--")


def _damping(axes: Axes, found: Onset, samples: Sequence[Sample]) -> None:
    value, real, imag = _points(samples)
    zeta = -real / np.hypot(real, imag)
    _over(axes, found)
    axes.axhline(0.0, color="k", lw=1)
    axes.plot(value, zeta, ".", ms=3, color="C0")
    reach = 3.0 * float(np.percentile(np.abs(zeta), 50)) if len(zeta) else 0.1
    reach = min(max(reach, 1e-3), SHOWN)
    axes.set(ylim=(-reach, reach), ylabel="damping ratio (below 0: grows)", title="root locus")
    legend: list[Any] = []
    for state, colour, text in (
        (True, "C2", "crossing, confirmed"),
        (None, "C1", "crossing, undecided"),
        (False, "C3", "crossing, contradicted"),
    ):
        if any(each.confirmation.confirmed is state for each in found.findings):
            legend += axes.plot([], [], color=colour, ls="--", lw=1, label=text)
    legend.append(axes.axvspan(np.nan, np.nan, color="C2", alpha=0.2, lw=0, label="stable"))
    axes.legend(handles=legend, fontsize="x-small", loc="upper right")


def _frequency(axes: Axes, found: Onset, samples: Sequence[Sample]) -> None:
    value, real, imag = _points(samples)
    _over(axes, found)
    hertz = imag / (2.0 * math.pi)
    stable = real < 0.0
    axes.plot(value[stable], hertz[stable], ".", ms=3, color="C0", label="decays")
    axes.plot(value[~stable], hertz[~stable], ".", ms=3, color="C3", label="grows")
    for each in found.findings:
        crossing = each.crossing
        if crossing.frequency:
            axes.plot(crossing.value, crossing.frequency, "o", mfc="none", mec="k", ms=7)
    if len(hertz) and hertz.max() > 5.0 * hertz.min():
        axes.set_yscale("log")
    _engineering(axes.yaxis, "Hz", *axes.get_ylim())
    axes.set(xlabel=found.axis.name, ylabel="ringing frequency")
    axes.legend(fontsize="x-small", loc="best")
