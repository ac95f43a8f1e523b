"""Picture of an onset: the pole map with damping lines, and the root locus over the value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taction.system.array_types import Floats
from taction.system.quantities import readable, show
from taction.verification.report.picture import BLUE, GREY, ORANGE, figure_file
from taction.verification.stability.edges import Sample
from taction.verification.studies.onset.onset import Onset

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

DAMPING = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7)
LABEL_ROOM = 0.1  # width of the label of a damping line over the width of the pole map
HEADROOM = 1.25
SHORT = 15.0  # ratio of the ends below which a logarithmic axis has labels between its decades
ABOVE = 16.0  # points between a panel and its title: room of the legend
MAX_DAMPING = 0.5  # damping ratio up to which a mode is on the pictures
NEAR = 6  # modes of each sample, nearest the imaginary axis, that set the limits of the pictures
UPPER_LEFT: dict[str, Any] = {"xytext": (0, -3), "textcoords": "offset points", "va": "top"}
# colour, line and word of a crossing that the transients confirm, leave open, or contradict
STATES = {
    True: (BLUE, "--", "confirmed"),
    None: (GREY, ":", "undecided"),
    False: (ORANGE, "-.", "contradicted"),
}

Modes = tuple[Floats, Floats, Floats]  # value on the axis, real and imaginary part of the pole


def plot_onset(onset: Onset, path: str | Path | None = None) -> Figure:
    """Draw the poles of every value in the complex plane, and damping and frequency over it.

    The figure is written to `path`, if there is one.

    Raises
    ------
    InputError
        See `taction.verification.report.picture.figure_file`.
    """
    samples = [sample for sample in onset.scan.samples if not sample.failure]
    modes = _ringing(samples)
    unit = onset.axis.key.unit
    ranges = [f"{_text(a, unit)} to {_text(b, unit)}" for a, b in onset.scan.stable_ranges]
    stable = (
        f"stable for {onset.axis.name} from {'; '.join(ranges)}" if ranges else "stable nowhere"
    )
    with figure_file(path, 11.5, 6.4, f"{onset.scene.name}: {stable}") as figure:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1))
        _pole_map(figure, figure.add_subplot(grid[:, 0]), onset, samples, modes)
        damping = figure.add_subplot(grid[0, 1])
        _damping(damping, onset, modes)
        _frequency(figure.add_subplot(grid[1, 1], sharex=damping), onset, modes)
        damping.tick_params(which="both", labelbottom=False)
    return figure


def _text(value: float, unit: str) -> str:
    return readable(show(value, unit))


def _ringing(samples: Sequence[Sample]) -> Modes:
    """Return value, real and imaginary part of every ringing pole with a positive frequency."""
    rows = [
        (sample.value, p.real, p.imag)
        for sample in samples
        for p in sample.poles[sample.poles.imag > 0.0].tolist()
        if -p.real < MAX_DAMPING * abs(p)
    ]
    value, real, imag = np.array(rows or np.zeros((0, 3))).T
    return value, real, imag


def _window(onset: Onset, samples: Sequence[Sample]) -> tuple[float, float, float]:
    """Return the left, right and upper limit of the pole map, 1/s."""
    near = [
        p
        for sample in samples
        for p in [p for p in sample.poles.tolist() if p.imag > 0.0 and math.isfinite(p.real)][:NEAR]
        if abs(p.real) < MAX_DAMPING * abs(p)
    ]
    ringing = [each.crossing for each in onset.findings if each.crossing.frequency]
    decisive = [crossing for crossing in ringing if crossing.changes_stability]
    omega = [abs(crossing.pole) for crossing in decisive or ringing]
    top = HEADROOM * max(omega or [p.imag for p in near] or [1.0])
    real = [p.real for p in near if p.imag < top] or [-top, top]
    left, right = np.percentile(real, (5, 95)).tolist()
    least = max(0.25 * (right - left), 1e-4 * top)
    return min(HEADROOM * left, -least), max(HEADROOM * right, least), top


def _pole_map(
    figure: Figure, axes: Axes, onset: Onset, samples: Sequence[Sample], modes: Modes
) -> None:
    from matplotlib.colors import LogNorm, Normalize

    left, right, top = _window(onset, samples)
    value, real, imag = modes
    scales = ((1e9, "G"), (1e6, "M"), (1e3, "k"))
    size, unit = next((scale for scale in scales if top >= scale[0]), (1.0, ""))
    norm = (LogNorm if onset.scan.logarithmic else Normalize)(samples[0].value, samples[-1].value)
    _damping_lines(axes, left, right, top, size)
    axes.axvline(0.0, color="k", lw=1)
    axes.axvspan(0.0, right / size, fc="none", ec=ORANGE, hatch="//", alpha=0.3, lw=0)
    dots = axes.scatter(real / size, imag / size, c=value, s=9, norm=norm, cmap="viridis", zorder=3)
    for each in onset.findings:
        axes.plot(0.0, each.crossing.pole.imag / size, "o", mfc="none", mec=ORANGE, ms=9, zorder=4)
    axes.set(xlim=(left / size, right / size), ylim=(0.0, top / size), title="pole map")
    axes.set(xlabel=f"real part ({unit}/s)", ylabel=f"imaginary part ({unit}rad/s)")
    label = onset.axis.name + (f" ({readable(onset.axis.key.unit)})" if onset.axis.key.unit else "")
    bar = figure.colorbar(dots, ax=axes, location="bottom", aspect=50, pad=0.01)
    _engineering(bar.ax.xaxis, "", samples[0].value, samples[-1].value)
    bar.set_label(label)


def _damping_lines(axes: Axes, left: float, right: float, top: float, size: float) -> None:
    """Draw rays of equal damping ratio that end at the upper edge."""
    room, last = LABEL_ROOM * (right - left) / size, -math.inf
    for zeta in DAMPING[::-1]:
        x = -zeta / math.sqrt(1.0 - zeta**2) * top / size
        if x * size <= 0.95 * left or x - last < room or -x < room:
            continue
        last = x
        axes.plot((0.0, x), (0.0, top / size), color="0.6", lw=0.7, ls="--", zorder=1)
        label = f"ζ = {zeta:g}"
        axes.annotate(label, (x, top / size), fontsize="x-small", color="0.4", **UPPER_LEFT)


def _engineering(axis: Axis, unit: str, low: float, high: float) -> None:
    """Label an axis with SI prefixes, a short logarithmic axis also between its decades."""
    from matplotlib.ticker import EngFormatter, NullFormatter

    short = low > 0.0 and high < SHORT * low
    unit = readable(unit)
    axis.set_major_formatter(EngFormatter(unit=unit))
    axis.set_minor_formatter(EngFormatter(unit=unit) if short else NullFormatter())


def _over(axes: Axes, onset: Onset) -> None:
    """Set up an axis over the swept value, with crossings and stable ranges on it."""
    if onset.scan.logarithmic:
        axes.set_xscale("log")
    unit = onset.axis.key.unit
    low, high = onset.scan.samples[0].value, onset.scan.samples[-1].value
    _engineering(axes.xaxis, unit, low, high)
    axes.set_xlim(low, high)
    for low, high in onset.scan.stable_ranges:
        axes.axvspan(low, high, color=BLUE, alpha=0.08, lw=0)
    for each in onset.findings:
        colour, line, _ = STATES[each.confirmation.confirmed]
        axes.axvline(each.crossing.value, color=colour, lw=1.2, ls=line)


def _damping(axes: Axes, onset: Onset, modes: Modes) -> None:
    value, real, imag = modes
    zeta = -real / np.hypot(real, imag)
    _over(axes, onset)
    axes.axhline(0.0, color="k", lw=1)
    axes.plot(value, zeta, ".", ms=3, color="k")
    reach = 3.0 * float(np.percentile(np.abs(zeta), 50)) if len(zeta) else 0.1
    reach = min(max(reach, 1e-3), MAX_DAMPING)
    axes.set(ylim=(-reach, reach), ylabel="damping ratio (below 0: grows)")
    axes.set_title("root locus", pad=ABOVE)
    legend: list[Any] = []
    for state, (colour, line, text) in STATES.items():
        if any(each.confirmation.confirmed is state for each in onset.findings):
            legend += axes.plot([], [], color=colour, ls=line, lw=1.2, label=f"crossing, {text}")
    legend.append(axes.axvspan(np.nan, np.nan, color=BLUE, alpha=0.2, lw=0, label="stable"))
    _legend_above(axes, handles=legend)


def _frequency(axes: Axes, onset: Onset, modes: Modes) -> None:
    value, real, imag = modes
    _over(axes, onset)
    hertz = imag / (2.0 * math.pi)
    stable = real < 0.0
    axes.plot(value[stable], hertz[stable], ".", ms=3, color=BLUE, label="decays")
    axes.plot(value[~stable], hertz[~stable], "^", ms=3, color=ORANGE, label="grows")
    for crossing in (each.crossing for each in onset.findings if each.crossing.frequency):
        axes.plot(crossing.value, crossing.frequency, "o", mfc="none", mec="k", ms=7)
    if len(hertz) and hertz.max() > 5.0 * hertz.min():
        axes.set_yscale("log")
    _engineering(axes.yaxis, "Hz", *axes.get_ylim())
    axes.set(xlabel=onset.axis.name, ylabel="ringing frequency")
    _legend_above(axes)


def _legend_above(axes: Axes, **more: Any) -> None:
    """Write the legend above the panel, where it covers nothing."""
    axes.legend(
        fontsize="x-small", loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False,
        borderaxespad=0.1, **more,
    )  # fmt: skip
