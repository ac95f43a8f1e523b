"""The picture of a verdict: outputs, deviation from the reference, recovered stress, checks."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taction.system.array_types import Floats
from taction.system.quantities import readable, show
from taction.verification.report.picture import (
    BLUE,
    GREY,
    ORANGE,
    OUTCOME_COLOURS,
    figure_file,
    label_ends,
    time_unit,
)
from taction.verification.report.tables import spaced
from taction.verification.report.verdict.table import amount, limit
from taction.verification.verdict.checks import Check
from taction.verification.verdict.companion import Agreement
from taction.verification.verdict.verify import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_LABELS = 12  # channels above which a colour bar names the channels
SAME = 2e-3  # of the height of a panel: lines that are closer look like one line
TITLES = ("check", "outcome", "value", "limit")
WIDTHS = (0.28, 0.28, 0.25, 0.19)
LINE = 62  # characters of a line below the checks
ROW = 0.27  # height of a row, inches
MOST_LINES = 12
SHOWN = 10  # rise times, or periods of the oscillation
AFTER = 1.1  # times the instant at which a record exceeds the supply: end of the panel
PALEST = 0.8  # of the colour map: yellow lines are too pale on white
CROWD = 24  # channels above which the marks are small


def plot_verdict(verdict: Verdict, path: str | Path | None = None) -> Figure:
    """Draw outputs with targets and settling band, recovered stress, and the checks.

    The figure is written to `path`, if there is one.

    Raises
    ------
    InputError
        See `taction.verification.report.picture.figure_file`.
    """
    agreement = verdict.agreement
    compared = agreement is not None and not agreement.reason
    heights = (1, 1, 0.55) if compared else (1, 1)
    title = f"{verdict.scene.name}: {_headline(verdict)}"
    with figure_file(path, 12, 9.2 if compared else 7.2, title) as figure:
        grid = figure.add_gridspec(len(heights), 2, width_ratios=(1.7, 1), height_ratios=heights)
        _early(figure, figure.add_subplot(grid[0, 0]), verdict)
        settling = figure.add_subplot(grid[1, 0])
        _settling(settling, verdict)
        _stress(figure.add_subplot(grid[0, 1]), verdict)
        _checks(figure.add_subplot(grid[1:, 1]), verdict)
        if agreement is not None and compared:
            _difference(figure.add_subplot(grid[2, 0], sharex=settling), verdict, agreement)
            settling.tick_params(labelbottom=False)
            settling.set_xlabel("")
    return figure


def _headline(verdict: Verdict) -> str:
    """Return the outcome, and what decides it or when the board settles."""
    settling, outcome = verdict.measurements.settling_time, verdict.outcome.value
    if outcome != "pass":
        names = ", ".join(spaced(c.name) for c in verdict.checks if c.outcome.value == outcome)
        return f"{outcome} ({names})"
    return outcome if settling is None else f"pass, settled at {_shown(settling.value, 's')}"


def _shown(value: float, unit: str, digits: int = 4) -> str:
    return readable(show(value, unit, digits))


def _early(figure: Figure, axes: Axes, verdict: Verdict) -> None:
    """Draw ten times the longest rise time, or ten periods of a board that oscillates."""
    channels = verdict.measurements.channels
    rises = [c.rise_time.value for c in channels if c.rise_time is not None]
    if not rises and verdict.poles.frequency > 0.0:
        rises = [1.0 / verdict.poles.frequency]
    time, colours = verdict.waveforms.time, _colours(len(channels))
    end = min(SHOWN * max(rises, default=math.inf), float(time[-1]))
    shown = slice(0, int(np.searchsorted(time, end)) + 1)  # up to the right edge
    size, name = time_unit(end)
    u, targets = verdict.u[shown], np.array([c.target for c in channels])
    low, high, note = _visible(u, targets, verdict.circuit.supply)
    groups = _same_lines(u, SAME * (high - low))
    for group in groups:
        for place, k in enumerate(group):
            style = "-" if place == 0 else (4.0 * place, (4.0, 4.0))
            axes.plot(time[shown] / size, u[:, k], color=colours[k], ls=style, lw=1.2)
            axes.axhline(targets[k], color=colours[k], ls=":", lw=0.8)
    axes.set(xlabel=f"time ({name})", ylabel="output (V)", xlim=(0, end / size), ylim=(low, high))
    axes.set_title(f"outputs, first rise; dotted: reference{note}")
    if len(channels) > MOST_LABELS:
        _channel_bar(figure, axes, len(channels))
        return
    names = [", ".join(f"$u_{{{k + 1}}}$" for k in group) for group in groups]
    firsts = [group[0] for group in groups]
    ends = np.clip(np.nan_to_num(u[-1, firsts]), low, high)
    label_ends(axes, names, ends, [colours[k] for k in firsts])


def _visible(u: Floats, targets: Floats, supply: float) -> tuple[float, float, str]:
    """Return the limits of the voltage axis, and what lies outside of them."""
    finite = np.where(np.isfinite(u), u, 0.0)
    low, high = min(finite.min(), targets.min()), max(finite.max(), targets.max())
    largest, reach = max(-low, high), max(supply, 1.2 * float(np.abs(targets).max()))
    note = ""
    if largest > reach:
        low, high = max(low, -reach), min(high, reach)
        note = f"\nthe record goes to {_shown(largest, 'V', 2)}; supply ±{_shown(supply, 'V', 3)}"
    room = 0.06 * max(high - low, 1e-30)
    return low - room, high + room, note


def _same_lines(u: Floats, distance: float) -> list[list[int]]:
    """Return the channels in groups whose lines are nowhere further than `distance` apart."""
    groups: list[list[int]] = []
    for k in range(u.shape[1]):
        for group in groups:
            if np.nanmax(np.abs(u[:, k] - u[:, group[0]])) <= distance:
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _channel_bar(figure: Figure, axes: Axes, count: int) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    colours = ListedColormap(colormaps["viridis"](np.linspace(0.0, PALEST, 256)))
    figure.colorbar(
        ScalarMappable(Normalize(1, count), colours), ax=axes, label="channel", pad=0.01
    )


def _settling(axes: Axes, verdict: Verdict) -> None:
    """Draw the record as deviation from the target, with the settling band."""
    t, m = verdict.waveforms.time, verdict.measurements
    scale, band, targets = (
        100.0 / (m.amplitude or 1.0),
        100 * m.band,
        [c.target for c in m.channels],
    )
    off = scale * (verdict.u - np.array(targets))
    reach, end = scale * verdict.circuit.supply, float(t[-1])
    title = f"deviation from the reference; grey: ±{band:g} % band"
    beyond = np.abs(off).max(axis=1) > reach
    if m.settling_time is None and beyond.any():
        end = min(AFTER * float(t[int(beyond.argmax())]), end)
        title += f"\nit grows beyond the supply; the record ends at {_shown(float(t[-1]), 's', 3)}"
    size, name = time_unit(end)
    shown = slice(0, int(np.searchsorted(t, end)) + 1)
    for colour, column in zip(_colours(len(targets)), off[shown].T, strict=True):
        axes.plot(t[shown] / size, column, color=colour, lw=0.6)
    axes.axhspan(-band, band, color="0.85", zorder=0)
    if m.settling_time is not None:
        axes.axvline(m.settling_time.value / size, color="k", ls="--", lw=1)
        title += f"; dashed: settled at {_shown(m.settling_time.value, 's')}"
        if verdict.outcome.value != "inconclusive":
            axes.set_ylim(-6 * band, 6 * band)
    else:
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, -reach), min(high, reach))
    axes.set(xlabel=f"time ({name})", ylabel="% of the step", xlim=(0, end / size))
    axes.set_title(title)


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


def _stress(axes: Axes, verdict: Verdict) -> None:
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    problem, U0 = verdict.problem, verdict.circuit.value("U0")
    channels = verdict.measurements.channels
    if problem.positions is None:
        where, label = np.arange(1.0, len(channels) + 1), "channel"
    else:
        where, label = problem.positions, "y (in depths)"
        where = where / getattr(verdict.scene.problem, "depth", 1.0)
    mark = 3.0 if len(channels) > CROWD else 6.0
    if problem.stress is not None:
        axes.plot(where, problem.stress, "o-", color=GREY, ms=mark, label="true stress")
    reference = np.array([c.target for c in channels]) / U0
    name = "regularised optimum"
    axes.plot(where, reference, "s-", ms=mark, mfc="none", color=BLUE, label=name)
    final = np.array([c.final for c in channels]) / U0
    if np.max(np.abs(final)) < 20 * (np.max(np.abs(reference)) + 1e-300):  # else off the scale
        axes.plot(where, final, "x", color=ORANGE, ms=mark, label="board, end of record")
    axes.axhline(0.0, color="k", lw=0.6)
    if problem.positions is None:
        few = len(channels) <= MOST_LABELS
        axes.xaxis.set_major_locator(MultipleLocator(1) if few else MaxNLocator(integer=True))
        axes.set_xlim(0.5, len(channels) + 0.5)
    axes.set(xlabel=label, ylabel="stress")
    axes.set_title("recovered stress", pad=22)
    axes.legend(
        fontsize="small", ncols=3, loc="lower center", bbox_to_anchor=(0.5, 0.98),
        frameon=False, columnspacing=1.0, handletextpad=0.4, borderpad=0.0,
    )  # fmt: skip


def _checks(axes: Axes, verdict: Verdict) -> None:
    """Write the checks with their limits, and below them why a check does not pass."""
    from matplotlib.transforms import Bbox

    axes.axis("off")
    rows = [
        (
            spaced(c.name),
            c.outcome.value,
            *(readable(amount(v, c.unit)) for v in (c.value, limit(c))),
        )
        for c in verdict.checks
    ]
    height = ROW * axes.figure.dpi / axes.bbox.height
    bottom = 1.0 - height * (len(rows) + 1)
    table = axes.table(
        rows, colLabels=TITLES, colWidths=WIDTHS, cellLoc="left", colLoc="left", edges="B",
        bbox=Bbox.from_bounds(0.0, bottom, 1.0, 1.0 - bottom),
    )  # fmt: skip
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    for row, check in enumerate(verdict.checks, 1):
        cell = table[row, 1].get_text()
        cell.set(color=OUTCOME_COLOURS[check.outcome.value], weight="bold")
    text = "\n".join(_reasons(verdict.checks))
    axes.text(0.0, bottom - 0.03, text, va="top", fontsize=8)


def _reasons(checks: tuple[Check, ...]) -> list[str]:
    """Return the reasons of the checks that do not pass, and that of the stability."""
    lines: list[str] = []
    for check in sorted(checks, key=lambda check: check.outcome.value == "pass"):
        if check.outcome.value != "pass" or check.name == "stability":
            lines += textwrap.wrap(readable(f"{spaced(check.name)}: {check.reason}"), LINE)
    return lines if len(lines) <= MOST_LINES else [*lines[: MOST_LINES - 1], "…"]


def _colours(count: int) -> list[Any]:
    from matplotlib import colormaps

    return [colormaps["viridis"](PALEST * k / max(count - 1, 1)) for k in range(count)]
