"""The picture of an inverse problem: the matrix with its signs, the strain, and the truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.problem import StatedProblem
from taction.system.array_types import Floats, Indices
from taction.system.picture import figure_file
from taction.system.picture_style import BLUE, GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WRITTEN = 12  # rows or columns up to which the entries are written into their squares
DARK = 0.3  # share of the largest entry above which a number is white


def plot_problem(scene: StatedProblem, path: str | Path | None = None) -> Figure:
    """Draw T as a map with signs beside the strain; write the figure to `path`, if given.

    Raises
    ------
    InputError
        The scene's files cannot be used, or see `taction.system.picture.figure_file`.
    """
    problem = make_problem(scene)
    rows, columns = problem.matrix.shape
    title = f"{scene.name}: eps = T u, {rows} sensors, {columns} channels"
    with figure_file(path, 11.0, 4.6, title) as figure:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.3, 1))
        _matrix(figure, figure.add_subplot(grid[:, 0]), problem.matrix)
        known = problem.stress is not None
        _strain(figure.add_subplot(grid[0 if known else slice(None), 1]), problem)
        if known:
            _stress(figure.add_subplot(grid[1, 1]), problem)
    return figure


def _matrix(figure: Figure, axes: Axes, T: Floats) -> None:
    """Draw the entries: blue is positive, orange negative, an empty square has no resistor."""
    from matplotlib.colors import FuncNorm, LinearSegmentedColormap

    reach = float(np.abs(T).max())
    colours = LinearSegmentedColormap.from_list("signs", ["#b04800", "#ffffff", "#005a92"])
    shown = np.ma.masked_equal(T, 0.0)
    norm = FuncNorm((_root, _square), -reach, reach)  # small entries are visible, too
    image = axes.imshow(shown, cmap=colours, norm=norm, aspect="auto")
    rows, columns = T.shape
    axes.set_xticks(_places(columns), _places(columns) + 1)
    axes.set_yticks(_places(rows), _places(rows) + 1)
    axes.grid(visible=False)
    axes.set(xlabel="channel", ylabel="sensor")
    if max(rows, columns) <= WRITTEN:
        for (k, n), value in np.ndenumerate(T):
            if value:
                colour = "white" if abs(value) > DARK * reach else "black"
                axes.text(n, k, f"{value:+.2g}", ha="center", va="center", color=colour, size=8)
    axes.set_title("matrix T; an empty square has no resistor")
    ticks = [share * reach for share in (-1.0, -0.5, -0.1, 0.0, 0.1, 0.5, 1.0)]
    figure.colorbar(image, ax=axes, pad=0.02, label="entry of T", ticks=ticks, format="{x:.2g}")


def _root(values: Floats) -> Floats:
    return np.sign(values) * np.sqrt(np.abs(values))


def _square(values: Floats) -> Floats:
    return values * np.abs(values)


def _places(count: int) -> Indices:
    step = max(1, -(-count // WRITTEN))
    return np.arange(0, count, step, dtype=np.intp)


def _strain(axes: Axes, problem: InverseProblem) -> None:
    _stems(axes, np.arange(1.0, len(problem.strain) + 1), problem.strain, BLUE)
    axes.set(xlabel="sensor", title="strain eps (the input)")


def _stress(axes: Axes, problem: InverseProblem) -> None:
    assert problem.stress is not None  # noqa: S101 - drawn only where it is known
    _stems(axes, np.arange(1.0, len(problem.stress) + 1), problem.stress, GREY)
    axes.set(xlabel="channel", title="true stress u (what the board shall recover)")


def _stems(axes: Axes, where: Floats, values: Floats, colour: str) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.vlines(where, 0.0, values, color=colour, lw=1.2)
    axes.plot(where, values, "o", color=colour, ms=4)
    axes.axhline(0.0, color="k", lw=0.6)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
