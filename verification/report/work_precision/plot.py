"""The picture of a work-precision study. matplotlib is imported where it is used."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from verification.report.verdict.plots import STYLE, check_plot_file, save
from verification.studies.work_precision.methods import Method
from verification.studies.work_precision.study import SettingResult, Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PROBLEMS = (("board", "whole board"), ("ideal", "network with ideal op-amps"))
MARKERS = "osDv^<>P"
LOWEST = 1e-15  # an error of exactly 0 is drawn here


def plot_study(study: Study, path: str) -> None:
    """Draw the largest error against run time and against the mean step, one row a problem.

    Filled marks are the points that the fitted order rests on, the dotted line is that fit; a bar
    spans the fastest and the slowest run; a cross at the upper edge timed out; the grey line is
    the reference's own error.

    Raises
    ------
    InputError
        See `verification.report.verdict.plots.check_plot_file`; or the file cannot be written.
    """
    check_plot_file(path)
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = [pair for pair in PROBLEMS if pair[0] in study.problems]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 4.6 * max(len(rows), 1) + 0.4), layout="constrained")
        FigureCanvasAgg(figure)
        grid = figure.subplots(max(len(rows), 1), 2, squeeze=False, sharey="row")
        for axes, (problem, title) in zip(grid, rows, strict=False):
            _work(axes[0], study, problem)
            _steps(axes[1], study, problem)
            axes[0].set_title(f"{title}: error against run time")
            axes[1].set_title("error against the mean step")
        figure.suptitle(f"{study.scene.name}: {study.extent.text}", fontweight="bold")
        save(figure, path)


def _methods(study: Study, problem: str) -> list[tuple[Method, str, str]]:
    """Return the methods of a problem with their colour and mark."""
    methods = dict.fromkeys(p.method for p in study.points if p.method.problem == problem)
    return [(m, f"C{k}", MARKERS[k % len(MARKERS)]) for k, m in enumerate(methods)]


def _error(point: SettingResult) -> float | None:
    error = point.errors["maximum"]
    return None if error is None else max(error, LOWEST)


def _work(axes: Axes, study: Study, problem: str) -> None:
    _floor(axes, study, problem)
    for method, colour, mark in _methods(study, problem):
        points = [p for p in study.of(method) if p.errors["maximum"] is not None]
        middle = np.array([p.seconds for p in points], dtype=np.float64)
        spread = np.array([[p.fastest, p.slowest] for p in points], dtype=np.float64).T
        bars = np.abs(spread - middle) if points else None
        errors = np.array([_error(p) for p in points], dtype=np.float64)
        axes.errorbar(
            middle, errors, xerr=bars, label=method.name, color=colour,
            marker=mark, ms=5, lw=1.2, elinewidth=0.8, capsize=2,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="wall time (s), median", ylabel=_LABEL)
    top = axes.get_ylim()[1]
    for method, colour, _ in _methods(study, problem):
        for point in study.of(method):
            if point.status == "timeout" and point.seconds is not None:
                _late(axes, point.seconds, top, f"timed out at {point.name}", colour)
    axes.legend(fontsize="small")


def _late(axes: Axes, seconds: float, top: float, text: str, colour: str) -> None:
    """Mark a run that used up its time at the upper edge: its error has no bound."""
    axes.plot(seconds, top, marker="X", ms=9, color=colour, clip_on=False, ls="none")
    place: dict[str, Any] = {"xytext": (0, -14), "textcoords": "offset points", "ha": "center"}
    axes.annotate(text, (seconds, top), fontsize="x-small", color=colour, **place)


_LABEL = "largest error over time (of the step)"


def _steps(axes: Axes, study: Study, problem: str) -> None:
    unit = study.extent.period if problem == "board" else 1.0
    for method, colour, mark in _methods(study, problem):
        points = study.of(method)
        order = study.orders[method.name]
        for place, point in enumerate(points):
            error = _error(point)
            if error is not None and point.mean_step is not None:
                face = colour if place in order.points else "none"
                axes.plot(point.mean_step / unit, error, mark, ms=5, color=colour, mfc=face)
        if order.value is not None and order.constant is not None:
            ends = np.array([points[order.points[k]].mean_step for k in (0, -1)], dtype=np.float64)
            label = f"{method.name}: order {order.value:.2f}"
            label += f" (theory {method.order:g})" if method.order is not None else " (varies)"
            line = order.constant * ends**order.value
            axes.plot(ends / unit, line, color=colour, ls=":", lw=1.4, label=label)
    name = "mean step (periods of the fastest ringing)" if problem == "board" else "mean step (s)"
    axes.set(xscale="log", yscale="log", xlabel=name)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize="small")


def _floor(axes: Axes, study: Study, problem: str) -> None:
    floor = study.problems[problem].floor["maximum"]
    if floor:
        axes.axhline(floor, color="0.6", lw=1, ls="--", zorder=0, label="the reference's own error")
