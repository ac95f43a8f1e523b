"""Pictures of a sweep: curves over one axis, maps over two, with the stability boundary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from netlist_gen.overrides.axes import Axis
from spice_models.array_types import Floats
from spice_models.errors import Complaint, InputError
from verification.report.sweep.files import OUTCOMES, grids
from verification.report.verdict.plots import check_plot_file, figure_file
from verification.studies.figures import FIGURES
from verification.studies.sweep.plan import Plan
from verification.studies.sweep.store import Store

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#59a14f", "#e15759", "#edc948", "#b07aa1")  # of OUTCOMES
MARKERS = ("o", "x", "^", "s")  # of OUTCOMES, for the second engine
LINES = {"ngspice": ("o", "C1", 7.0), "statespace": ("-", "C0", 4.0)}
MOST_MARKERS = 2500  # above, marks would overlap


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel: a figure of the records, its title, its factor and the kind of its scale."""

    name: str
    title: str
    factor: float
    scale: str

    @property
    def unit(self) -> str:
        """Unit of the figure."""
        return FIGURES[self.name].unit


PANELS = (
    Panel("settling_time", "settling time", 1.0, "log"),
    Panel("overshoot", "overshoot (% of the step)", 100.0, "linear"),
    Panel("undershoot", "undershoot (% of the step)", 100.0, "linear"),
    Panel("steady_state_error", "steady-state error (% of the step)", 100.0, "log"),
    Panel("growth_rate", "rightmost pole, real part (1/s)", 1.0, "symlog"),
)


def check_sweep_plot(plan: Plan, path: str) -> None:
    """Refuse a picture that could not be drawn, before any work is done.

    Raises
    ------
    InputError
        More than two axes, or see `verification.report.verdict.plots.check_plot_file`.
    """
    check_plot_file(path)
    if len(plan.groups) > 2:
        text = (
            f"{len(plan.groups)} axes; a picture has one or two axes, --export writes all of them"
        )
        raise InputError("--plot", Complaint("FILE", repr(path), text))


def plot_sweep(plan: Plan, store: Store, path: str) -> None:
    """Draw the figures of `PANELS` and the outcome over the grid.

    Raises
    ------
    InputError
        See `check_sweep_plot`; or the file cannot be written.
    """
    check_sweep_plot(plan, path)
    title = f"{plan.scene.name}: {plan.points} points, {' and '.join(plan.engines)}"
    with figure_file(path, 16.0, 8.2, title) as figure:
        data = grids(plan, store)
        for name in ("overshoot", "undershoot"):  # of a growing record: depends on its length
            data[name][data["growth_rate"] > 0.0] = np.nan
        draw = _maps if len(plan.groups) == 2 else _curves
        draw(figure, plan, data)


def _maps(figure: Figure, plan: Plan, data: dict[str, Any]) -> None:
    panels = figure.subplots(2, 3)
    across, down = (_Ruler(group[0]) for group in plan.groups)
    data = {name: array.swapaxes(0, 1) for name, array in data.items()}  # the first axis is x
    growth = data["growth_rate"][..., -1]
    for axes, quantity in zip(panels.flat, PANELS, strict=False):
        _map(figure, axes, quantity, data[quantity.name][..., -1], (across, down))
    _outcomes(panels.flat[-1], plan, data["outcome"], data["agreement"], (across, down))
    for axes in panels.flat:
        across.mark(axes, "x")
        down.mark(axes, "y")
        axes.grid(visible=False)
        if np.nanmin(growth, initial=0.0) < 0.0 < np.nanmax(growth, initial=0.0):
            axes.contour(across.places, down.places, growth, [0.0], colors="k", linewidths=2.0)
    text = "black line: stability boundary (a pole crosses the imaginary axis); grey: no value"
    if len(plan.engines) == 2:
        text += "\noutcome: squares are the state-space engine's verdicts, marks on them ngspice's"
    figure.supxlabel(text, fontsize="small")


def _map(
    figure: Figure, axes: Axes, quantity: Panel, values: Floats, rulers: tuple[_Ruler, _Ruler]
) -> None:
    from matplotlib.colors import LogNorm, Normalize, SymLogNorm

    shown = np.ma.masked_invalid(quantity.factor * values)
    axes.set_facecolor("0.85")
    axes.set_title(quantity.title)
    if not shown.count():
        axes.text(0.5, 0.5, "nowhere", transform=axes.transAxes, ha="center")
        return
    low, high = float(shown.min()), float(shown.max())
    if quantity.scale == "log":
        norm: Any = LogNorm(low, max(high, low * 1.01))
    elif quantity.scale == "symlog":
        reach = max(abs(low), abs(high))
        norm = SymLogNorm(1e-3 * reach, vmin=-reach, vmax=reach)
    else:
        norm = Normalize(low, max(high, low + 1e-12))
    colours = "RdBu_r" if quantity.scale == "symlog" else "viridis"
    across, down = rulers
    mesh = axes.pcolormesh(across.edges, down.edges, shown, norm=norm, cmap=colours)
    bar = figure.colorbar(mesh, ax=axes)
    if quantity.scale == "log":
        _tick(bar.ax.yaxis, quantity.unit, low, high)


def _outcomes(
    axes: Axes,
    plan: Plan,
    outcome: np.ndarray[Any, Any],
    agreement: np.ndarray[Any, Any],
    rulers: tuple[_Ruler, _Ruler],
) -> None:
    """Fill the cells with the verdicts of the last engine; marks show those of the first engine."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    across, down = rulers
    shown = np.ma.masked_less(outcome[..., -1], 0)
    colours = ListedColormap(COLOURS)
    axes.set_facecolor("white")
    axes.pcolormesh(across.edges, down.edges, shown, cmap=colours, vmin=-0.5, vmax=3.5)
    present = [k for k in range(len(OUTCOMES)) if np.any(outcome == k)]
    handles: list[Any] = [Patch(color=COLOURS[k], label=OUTCOMES[k]) for k in present]
    if len(plan.engines) == 2 and shown.size <= MOST_MARKERS:
        x, y = np.meshgrid(across.places, down.places)
        for k in present:
            cells = outcome[..., 0] == k
            size = max(4.0, min(40.0, 6e3 / shown.size))
            marks = axes.scatter(x[cells], y[cells], size, c="k", marker=MARKERS[k], linewidths=0.8)
            marks.set_label(f"{plan.engines[0]}: {OUTCOMES[k]}")
            handles.append(marks)
    axes.set_title(f"outcome{_disagreements(agreement)}" if len(plan.engines) == 2 else "outcome")
    axes.legend(handles=handles, fontsize="x-small", loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _disagreements(agreement: np.ndarray[Any, Any]) -> str:
    count = int((agreement[..., 0] == OUTCOMES.index("fail")).sum())
    return f", the engines disagree at {count} points" if count else ", the engines agree"


def _curves(figure: Figure, plan: Plan, data: dict[str, Any]) -> None:
    panels = figure.subplots(2, 3, sharex=True)
    ruler = _Ruler(plan.groups[0][0])
    unstable = np.nanmax(data["growth_rate"], axis=-1, initial=-np.inf) > 0.0
    for axes, quantity in zip(panels.flat, PANELS, strict=False):
        for k, engine in enumerate(plan.engines):
            style, colour, size = LINES[engine]
            values = quantity.factor * data[quantity.name][..., k]
            style = style if len(ruler.places) > 1 else "o"
            axes.plot(ruler.places, values, style, color=colour, ms=size, mfc="none", label=engine)
        axes.set_title(quantity.title)
        if quantity.scale == "symlog":
            largest = float(np.nanmax(np.abs(data[quantity.name]), initial=1.0))
            axes.set_yscale("symlog", linthresh=1e-3 * largest)
            axes.axhline(0.0, color="k", lw=1.0)
        elif quantity.scale == "log" and np.isfinite(data[quantity.name]).any():
            axes.set_yscale("log")
            ends = (float(limit(data[quantity.name])) for limit in (np.nanmin, np.nanmax))
            _tick(axes.yaxis, quantity.unit, *ends)
    _strip(panels.flat[-1], plan, data["outcome"], ruler)
    for axes in panels.flat:
        ruler.mark(axes, "x")
        for left, right in zip(ruler.edges[:-1][unstable], ruler.edges[1:][unstable], strict=True):
            axes.axvspan(left, right, color="C3", alpha=0.12, lw=0.0, zorder=0)
    panels.flat[0].legend(fontsize="small")
    figure.supxlabel("red: unstable by its poles", fontsize="small")


def _strip(axes: Axes, plan: Plan, outcome: np.ndarray[Any, Any], ruler: _Ruler) -> None:
    for k, name in enumerate(OUTCOMES):
        rows, columns = np.nonzero(outcome == k)
        if rows.size:
            places, colour, mark = ruler.places[rows], COLOURS[k], MARKERS[k]
            axes.scatter(places, columns, 30, c=colour, marker=mark, label=name)
    axes.set(title="outcome", ylim=(-0.6, len(plan.engines) - 0.4))
    axes.set_yticks(range(len(plan.engines)), plan.engines)
    axes.legend(fontsize="small", loc="best")


class _Ruler:
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
            _tick(ruler, self.axis.key.unit, self.edges[0], self.edges[-1] if self.log else 0.0)
        else:
            write = _prefixes(self.axis.key.unit)
            names = [write(v) if isinstance(v, float) else str(v) for v in self.axis.values]
            (axes.set_xticks if which == "x" else axes.set_yticks)(self.places, names)


def _tick(ruler: Any, unit: str, low: float, high: float) -> None:
    """Write values with SI prefixes, at 1, 2 and 5 of each decade if there are few decades."""
    from matplotlib.ticker import LogLocator, NullFormatter

    ruler.set_major_formatter(_prefixes(unit))
    if high > 0.0:
        short = high < 300.0 * low
        ruler.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if short else (1.0,)))
        ruler.set_minor_formatter(NullFormatter())


def _prefixes(unit: str) -> Any:
    from matplotlib.ticker import EngFormatter, StrMethodFormatter

    return EngFormatter(unit.replace("ohm", "Ω")) if unit else StrMethodFormatter("{x:g}")
