"""Picture of a work-precision study."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taction.verification.report.picture import figure_file
from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.study import SettingResult, WorkPrecisionStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PROBLEMS = (("board", "whole board"), ("ideal", "network with ideal op-amps"))
MARKERS = "osDv^<>P"
LOWEST = 1e-15  # place of an error of exactly 0
ERROR_LABEL = "largest error over time (of the step)"
BELOW: dict[str, Any] = {"xytext": (0, -14), "textcoords": "offset points", "ha": "center"}


def plot_study(study: WorkPrecisionStudy, path: str) -> None:
    """Draw the largest error against run time and against the mean step, a row for each problem.

    The order is fitted to the filled marks, the dotted line shows the fit; a bar ends at the
    fastest and the slowest run; a cross at the upper edge is a run that timed out; the grey line
    is the error of the reference.

    Raises
    ------
    InputError
        See `taction.verification.report.picture.figure_file`.
    """
    rows = [pair for pair in PROBLEMS if pair[0] in study.problems]
    height, title = max(len(rows), 1), f"{study.scene.name}: {study.extent.text}"
    with figure_file(path, 12, 4.6 * height + 0.4, title) as figure:
        grid = figure.subplots(height, 2, squeeze=False, sharey="row")
        for axes, (problem, name) in zip(grid, rows, strict=False):
            _work(axes[0], study, problem)
            _steps(axes[1], study, problem)
            axes[0].set_title(f"{name}: error against run time{_lonely(study, problem)}")
            axes[1].set_title("error against the mean step")


def _methods(study: WorkPrecisionStudy, problem: str) -> list[tuple[Method, str, str]]:
    """Return the methods of a problem with their colour and mark."""
    methods = dict.fromkeys(p.method for p in study.points if p.method.problem == problem)
    return [(m, f"C{k}", MARKERS[k % len(MARKERS)]) for k, m in enumerate(methods)]


def _lonely(study: WorkPrecisionStudy, problem: str) -> str:
    """Return that a single run shows no trend, or an empty text."""
    points = [p for m, *_ in _methods(study, problem) for p in study.of(m)]
    measured = [p for p in points if p.errors["maximum"] is not None]
    if len(measured) > 1:
        return ""
    return "\nonly one run was measured: no trend" if measured else "\nno run was measured"


def _error(point: SettingResult) -> float | None:
    error = point.errors["maximum"]
    return None if error is None else max(error, LOWEST)


def _work(axes: Axes, study: WorkPrecisionStudy, problem: str) -> None:
    if floor := study.problems[problem].floor["maximum"]:
        axes.axhline(floor, color="0.6", lw=1, ls="--", zorder=0, label="error of the reference")
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
    axes.set(xscale="log", yscale="log", xlabel="wall time, median", ylabel=ERROR_LABEL)
    _in_seconds(axes)
    top = axes.get_ylim()[1]
    for method, colour, _ in _methods(study, problem):
        for point in study.of(method):
            if point.status == "timeout" and point.seconds is not None:
                # At the upper edge, since the error of this run has no bound.
                axes.plot(point.seconds, top, "X", ms=9, color=colour, clip_on=False)
                text, place = f"timed out at {point.name}", (point.seconds, top)
                axes.annotate(text, place, fontsize="x-small", color=colour, **BELOW)
    axes.legend(fontsize="small")


def _steps(axes: Axes, study: WorkPrecisionStudy, problem: str) -> None:
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
    periods = problem == "board"
    name = "mean step (periods of the fastest ringing)" if periods else "mean step"
    axes.set(xscale="log", yscale="log", xlabel=name)
    if not periods:
        _in_seconds(axes)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize="small")


def _in_seconds(axes: Axes) -> None:
    """Write the times of a logarithmic axis with SI prefixes, at 1, 2 and 5 of each decade."""
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)))
    axes.xaxis.set_major_formatter(EngFormatter("s"))
    axes.xaxis.set_minor_formatter(NullFormatter())
