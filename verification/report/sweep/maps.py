"""Maps of a sweep over two axes, and small maps for each value of a third axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taction.netlist_gen.scene.axes import Axis
from taction.system.array_types import Floats
from taction.verification.report.sweep.panels import (
    LITTLE,
    PANELS,
    Kind,
    Panel,
    kinds_of,
    linear_part,
    rate_ticks,
)
from taction.verification.report.sweep.rulers import Ruler, prefixes, tick
from taction.verification.studies.sweep.boundary import Boundary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = {"pass": "o", "fail": "x", "inconclusive": "^", "error": "s"}  # of the other engine
MOST_MARKERS = 2500  # above, marks would overlap
MOST_MAPS = 6  # small maps beside each other
SOLVED = "black: stability boundary, solved between the points (a pole crosses the imaginary axis)"
INTERPOLATED = "black: stability boundary, interpolated, since {why}"
Words = np.ndarray[Any, Any]


def draw_maps(
    figure: Figure,
    axes_of_plan: tuple[Axis, Axis],
    data: dict[str, Any],
    names: Words,
    boundary: Boundary,
    engines: tuple[str, ...],
) -> None:
    """Draw the figures of `PANELS` and what fails over two axes.

    `data` and `names` have the shape of the grid, and the engine last.
    """
    across, down = (Ruler(axis) for axis in axes_of_plan)
    data = {name: array.swapaxes(0, 1) for name, array in data.items()}  # the first axis is x
    panels = figure.subplots(2, 3)
    for axes, quantity in zip(panels.flat, PANELS, strict=False):
        _map(figure, axes, quantity, data[quantity.name][..., -1], (across, down))
    last = panels.flat[-1]
    kinds = kinds_of(names.ravel().tolist())
    _results(last, names.swapaxes(0, 1)[..., -1], kinds, (across, down))
    handles = _handles(kinds)
    if len(engines) == 2:
        handles += _marks(last, names.swapaxes(0, 1)[..., 0], engines[0], (across, down))
        last.set_title(f"outcome{_disagreements(data['agreement'])}")
    figure.legend(handles=handles, fontsize="small", loc="outside right lower")
    for axes in panels.flat:
        _finish(axes, across, down, boundary, data["growth_rate"][..., -1])
    text = f"{boundary_text(boundary)}; grey: no value"
    if len(engines) == 2:
        text += "\noutcome: cells are the state-space engine's verdicts, marks ngspice's"
    figure.supxlabel(text, fontsize="small")


def draw_multiples(
    figure: Figure,
    axes_of_plan: tuple[Axis, Axis, Axis],
    data: dict[str, Any],
    names: Words,
    boundaries: list[Boundary],
    chosen: list[int],
) -> None:
    """Draw settling time and what fails over two axes, for the `chosen` values of the third."""
    *plane, third = axes_of_plan
    across, down = (Ruler(axis) for axis in plane)
    panels = figure.subplots(2, len(chosen), squeeze=False, sharex=True, sharey=True)
    kinds = kinds_of(names[:, :, chosen].ravel().tolist())
    shared = PANELS[0].factor * data[PANELS[0].name][:, :, chosen, -1]
    write = prefixes(third.key.unit)
    for place, (upper, lower) in enumerate(panels.T):
        k, value = chosen[place], third.values[chosen[place]]
        growth = data["growth_rate"][:, :, k, -1].T
        limits = (float(np.nanmin(shared)), float(np.nanmax(shared))) if _any(shared) else None
        mesh = _mesh(upper, PANELS[0], shared[:, :, place].T, (across, down), limits)
        if mesh is not None and place == len(chosen) - 1:
            _bar(figure, panels[0].tolist(), PANELS[0], mesh, limits or (1.0, 1.0))
        _results(lower, names[:, :, k, -1].T, kinds, (across, down))
        for axes in (upper, lower):
            _finish(axes, across, down, boundaries[place], growth)
            axes.label_outer()
        words = write(value) if isinstance(value, float) else str(value)
        upper.set_title(f"{third.name} = {words}")
    panels[0, 0].set_ylabel(f"settling time\n{down.axis.name}")
    panels[1, 0].set_ylabel(f"outcome\n{down.axis.name}")
    figure.legend(handles=_handles(kinds), fontsize="small", loc="outside right lower")
    shown = f"{len(chosen)} of {len(third)} values of {third.name}; "
    text = (shown if len(chosen) < len(third) else "") + boundary_text(boundaries[0])
    figure.supxlabel(f"{text}; grey: no value", fontsize="small")


def boundary_text(boundary: Boundary) -> str:
    """Return what the black line is."""
    return INTERPOLATED.format(why=boundary.unsolved) if boundary.unsolved else SOLVED


def _any(values: Floats) -> bool:
    return bool(np.isfinite(values).any())


def _map(
    figure: Figure, axes: Axes, quantity: Panel, values: Floats, rulers: tuple[Ruler, Ruler]
) -> None:
    axes.set_title(quantity.title)
    shown = quantity.factor * values
    mesh = _mesh(axes, quantity, shown, rulers, None)
    if mesh is not None:
        _bar(figure, [axes], quantity, mesh, (float(np.nanmin(shown)), float(np.nanmax(shown))))


def _bar(
    figure: Figure, axes: list[Axes], quantity: Panel, mesh: Any, limits: tuple[float, float]
) -> None:
    bar = figure.colorbar(mesh, ax=axes, pad=0.015)
    if quantity.scale == "log":
        tick(bar.ax.yaxis, quantity.unit, *limits)
    elif quantity.scale == "symlog":
        ticks = rate_ticks(max(map(abs, limits)))
        bar.set_ticks(ticks, labels=[prefixes("/s")(tick) for tick in ticks])
        bar.ax.minorticks_off()


def _mesh(
    axes: Axes,
    quantity: Panel,
    values: Floats,
    rulers: tuple[Ruler, Ruler],
    limits: tuple[float, float] | None,
) -> Any:
    """Draw the cells of a quantity; return None where no cell has a value."""
    from matplotlib.colors import LogNorm, Normalize, SymLogNorm

    shown = np.ma.masked_invalid(values)
    axes.set_facecolor("0.85")
    if not shown.count():
        axes.text(0.5, 0.5, "nowhere", transform=axes.transAxes, ha="center")
        return None
    if quantity.is_rounding(values):
        axes.text(0.5, 0.5, LITTLE, transform=axes.transAxes, ha="center", backgroundcolor="0.85")
        return None
    low, high = limits or (float(shown.min()), float(shown.max()))
    if quantity.scale == "log":
        norm: Any = LogNorm(low, max(high, low * 1.01))
    elif quantity.scale == "symlog":
        reach = max(abs(low), abs(high))
        norm = SymLogNorm(linear_part(reach), vmin=-reach, vmax=reach)
    else:
        norm = Normalize(low, max(high, low + 1e-12))
    colours = "PuOr_r" if quantity.scale == "symlog" else "viridis"
    across, down = rulers
    return axes.pcolormesh(across.edges, down.edges, shown, norm=norm, cmap=colours)


def _results(
    axes: Axes, names: Words, kinds: tuple[Kind, ...], rulers: tuple[Ruler, Ruler]
) -> None:
    """Fill the cells with the colour and the hatching of their kind."""
    from matplotlib.colors import ListedColormap

    across, down = rulers
    axes.set_facecolor("white")
    axes.set_title("outcome")
    for kind in kinds:
        cells = np.ma.masked_not_equal((names == kind.name).astype(np.int8), 1)
        if cells.count():
            axes.pcolor(
                across.edges, down.edges, cells, cmap=ListedColormap([kind.colour]),
                hatch=kind.hatch, edgecolor=("white" if kind.hatch else "none"), linewidth=0.0,
            )  # fmt: skip


def _handles(kinds: tuple[Kind, ...]) -> list[Any]:
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=kind.colour, hatch=kind.hatch, edgecolor="white", label=kind.name)
        for kind in kinds
    ]


def _marks(axes: Axes, names: Words, engine: str, rulers: tuple[Ruler, Ruler]) -> list[Any]:
    """Mark the outcomes of the other engine on the cells."""
    if names.size > MOST_MARKERS:
        return []
    x, y = np.meshgrid(rulers[0].places, rulers[1].places)
    size, marks = max(4.0, min(40.0, 6e3 / names.size)), []
    for outcome, marker in MARKERS.items():
        cells = np.array([[name.startswith(outcome) for name in row] for row in names], np.bool_)
        if cells.any():
            label = f"{engine}: {outcome}"
            marks.append(
                axes.scatter(x[cells], y[cells], size, c="k", marker=marker, lw=0.8, label=label)
            )
    return marks


def _disagreements(agreement: np.ndarray[Any, Any]) -> str:
    count = int((agreement[..., 0] == 1).sum())
    return f", the engines disagree at {count} points" if count else ", the engines agree"


def _finish(axes: Axes, across: Ruler, down: Ruler, boundary: Boundary, growth: Floats) -> None:
    """Draw the boundary and the ticks."""
    from matplotlib.collections import LineCollection

    across.mark(axes, "x")
    down.mark(axes, "y")
    axes.grid(visible=False)
    axes.set(xlim=across.edges[[0, -1]], ylim=down.edges[[0, -1]])
    if boundary.unsolved:
        if np.nanmin(growth, initial=0.0) < 0.0 < np.nanmax(growth, initial=0.0):
            axes.contour(across.places, down.places, growth, [0.0], colors="k", linewidths=2.0)
        return
    axes.add_collection(LineCollection(list(boundary.segments), colors="k", linewidths=2.0))
    if not boundary.segments:  # an axis is a list: a mark across each of its cells
        ends = [_across_the_cell(point, across, down) for point in boundary.points]
        axes.add_collection(LineCollection(ends, colors="k", linewidths=2.0))


def _across_the_cell(
    point: tuple[float, float], across: Ruler, down: Ruler
) -> list[tuple[float, float]]:
    x, y = point
    if across.by_value:
        return [(x, y - 0.5), (x, y + 0.5)]
    return [(x - 0.5, y), (x + 0.5, y)]
