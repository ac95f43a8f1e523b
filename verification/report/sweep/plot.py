"""Pictures of a sweep: curves over one axis, maps over two, small maps over three."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taction.netlist_gen.scene.axes import with_values
from taction.system.errors import Complaint, InputError
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.report.picture import check_plot_file, figure_file
from taction.verification.report.sweep.curves import draw_curves
from taction.verification.report.sweep.files import grids
from taction.verification.report.sweep.maps import MOST_MAPS, draw_maps, draw_multiples
from taction.verification.report.sweep.panels import ENGINES, result_names
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.boundary import Boundary, solve_boundary
from taction.verification.studies.sweep.plan import Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_AXES = 3


def check_sweep_plot(plan: Plan, path: str | Path | None) -> None:
    """Refuse a picture that could not be drawn, before any work is done.

    Raises
    ------
    InputError
        More than three axes, or see `taction.verification.report.picture.check_plot_file`.
    """
    if path is not None:
        check_plot_file(path)
    if len(plan.groups) > MOST_AXES:
        text = f"{len(plan.groups)} axes; a picture has at most three, --export writes all of them"
        raise InputError("--plot", Complaint("FILE", repr(path and str(path)), text))


def plot_sweep(plan: Plan, store: Store, path: str | Path | None = None) -> Figure:
    """Draw the figures of a sweep, what fails, and over two axes the stability boundary.

    The figure is written to `path`, if there is one.

    Raises
    ------
    InputError
        See `check_sweep_plot`; or the file cannot be written.
    """
    check_sweep_plot(plan, path)
    data, names = grids(plan, store), result_names(plan, store)
    for name in EXCURSIONS:  # of a growing record: depends on its length
        data[name][data["growth_rate"] > 0.0] = np.nan
    passing = int((names[..., -1] == "pass").sum())
    engines = " and ".join(ENGINES[engine] for engine in plan.engines)
    title = f"{plan.scene.name}: {passing} of {plan.points} points pass, {engines}"
    axes: Any = tuple(group[0] for group in plan.groups)
    chosen = chosen_places(len(axes[2])) if len(axes) == MOST_AXES else []
    width = 16.0 if not chosen else 4.2 + 3.4 * len(chosen)
    with figure_file(path, width, 8.2, title) as figure:
        if len(axes) == 1:
            draw_curves(figure, axes[0], data, names, plan.engines)
        elif len(axes) == 2:
            draw_maps(figure, axes, data, names, solve_boundary(plan), plan.engines)
        else:
            solved = [boundary_at(plan, k) for k in chosen]
            draw_multiples(figure, axes, data, names, solved, chosen)
    return figure


def chosen_places(count: int) -> list[int]:
    """Return the places of the values of the third axis that have a map: first, last, between."""
    places = np.linspace(0, count - 1, min(count, MOST_MAPS)).round()
    return [int(place) for place in np.unique(places)]


def boundary_at(plan: Plan, number: int) -> Boundary:
    """Solve the stability boundary at a value of the third axis, by its place."""
    changes = {axis.key.path: axis.values[number] for axis in plan.groups[2]}
    scene = with_values(plan.scene, changes)
    return solve_boundary(Plan(scene, plan.groups[:2], plan.engines))
