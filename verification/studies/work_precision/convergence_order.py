"""Fit the order of convergence to the asymptotic part of a ladder of runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats

MAX_ERROR = 0.1  # a larger error is not asymptotic
ABOVE_FLOOR = 10.0  # least error of a run, in errors of the reference
SCATTER = 0.12  # rms deviation of ln(error) from a straight line, over its slope
MIN_RUNS = 3


@dataclass(frozen=True, slots=True)
class Order:
    """A fitted order of convergence, ``error = constant * step^value``; None without an order."""

    value: float | None
    sigma: float | None  # standard uncertainty of `value`
    constant: float | None  # error at a step of 1 s
    points: tuple[int, ...]  # places in the ladder that the fit used
    reason: str  # why points were left out, or why there is no order


def fit_order(
    steps: Sequence[float | None],
    errors: Sequence[float | None],
    floor: float,
    names: Sequence[str],
) -> Order:
    """Fit a straight line to ``ln error`` over ``ln step`` where the ladder is asymptotic.

    Points with an error above `MAX_ERROR` or below `ABOVE_FLOOR` times `floor` are left out. Of the
    others the fit uses the longest sequence of neighbours near a straight line (`SCATTER`), the
    finer one of two sequences of the same length.

    Parameters
    ----------
    steps : sequence of float or None
        Mean step of each run, s; coarse to fine. None where there is no run.
    errors : sequence of float or None
        Error of each run; None where it is unknown.
    floor : float
        Error of the reference.
    names : sequence of str
        Names of the runs in `Order.reason`.
    """
    usable, omissions = [], []
    for place, (step, error) in enumerate(zip(steps, errors, strict=True)):
        if step is None or error is None or not (step > 0.0 and math.isfinite(error)):
            omissions.append(f"{names[place]} has no error")
        elif error > MAX_ERROR:
            omissions.append(f"{names[place]} is not asymptotic")
        elif error < ABOVE_FLOOR * floor:
            omissions.append(f"{names[place]} is at the reference's own error")
        else:
            usable.append(place)
    x = np.log([float(steps[k] or 1.0) for k in usable])
    y = np.log([float(errors[k] or 1.0) for k in usable])
    for count in range(len(usable), MIN_RUNS - 1, -1):
        for first in range(len(usable) - count, -1, -1):
            part = slice(first, first + count)
            line = _line(x[part], y[part])
            if line is not None:
                used = usable[part]
                omissions += [f"{names[k]} is off the line" for k in usable if k not in used]
                return Order(*line, tuple(used), "; ".join(omissions))
    reason = f"fewer than {MIN_RUNS} runs on a straight line"
    return Order(None, None, None, (), "; ".join([reason, *omissions]))


def _line(x: Floats, y: Floats) -> tuple[float, float, float] | None:
    """Return slope, uncertainty and constant; None if the points are not on a line."""
    spread = x - x.mean()
    width = float(spread @ spread)
    if width <= 0.0:
        return None
    slope = float(spread @ y) / width
    residual = y - y.mean() - slope * spread
    scatter = float(np.sqrt(residual @ residual / max(len(x) - 2, 1)))
    if slope <= 0.0 or scatter > SCATTER * slope:
        return None
    return slope, scatter / math.sqrt(width), float(np.exp(y.mean() - slope * x.mean()))
