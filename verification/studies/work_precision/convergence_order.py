"""The order of convergence that a ladder of runs shows, from its asymptotic part alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats

LARGEST = 0.1  # error above which a method does not follow the solution yet
ABOVE_FLOOR = 10.0  # times the reference's own error: below, the reference is measured
SCATTER = 0.12  # rms deviation of ln(error) from a straight line, over its slope
FEWEST = 3


@dataclass(frozen=True, slots=True)
class Order:
    """A fitted order of convergence, ``error = constant * step^value``.

    Attributes
    ----------
    value, sigma : float or None
        Slope and its standard uncertainty; None where the ladder shows no order.
    constant : float or None
        Error at a step of 1 s.
    points : tuple of int
        Places in the ladder that the fit used.
    reason : str
        Which points were left out and why, or why there is no order.
    """

    value: float | None
    sigma: float | None
    constant: float | None
    points: tuple[int, ...]
    reason: str


def fit_order(
    steps: Sequence[float | None],
    errors: Sequence[float | None],
    floor: float,
    names: Sequence[str],
) -> Order:
    """Fit a straight line to ``ln error`` over ``ln step`` where the ladder is asymptotic.

    Points with an error above `LARGEST`, or below ten times `floor`, are left out; of what remains
    the longest run of neighbours is taken that a straight line fits (`SCATTER`), the finer one of
    two of the same length.

    Parameters
    ----------
    steps : sequence of float or None
        Mean step of each run, s; coarse to fine. None where there is no run.
    errors : sequence of float or None
        Error of each run; None where there is none.
    floor : float
        Error of the reference itself.
    names : sequence of str
        What to call each run in `Order.reason`.
    """
    usable, left = [], []
    for place, (step, error) in enumerate(zip(steps, errors, strict=True)):
        if step is None or error is None or not (step > 0.0 and math.isfinite(error)):
            left.append(f"{names[place]} has no error")
        elif error > LARGEST:
            left.append(f"{names[place]} is not asymptotic")
        elif error < ABOVE_FLOOR * floor:
            left.append(f"{names[place]} is at the reference's own error")
        else:
            usable.append(place)
    x = np.log([float(steps[k] or 1.0) for k in usable])
    y = np.log([float(errors[k] or 1.0) for k in usable])
    for count in range(len(usable), FEWEST - 1, -1):
        for first in range(len(usable) - count, -1, -1):
            part = slice(first, first + count)
            line = _line(x[part], y[part])
            if line is not None:
                used = usable[part]
                left += [f"{names[k]} is off the line" for k in usable if k not in used]
                return Order(*line, tuple(used), "; ".join(left))
    why = f"fewer than {FEWEST} runs on a straight line"
    return Order(None, None, None, (), "; ".join([why, *left]))


def _line(x: Floats, y: Floats) -> tuple[float, float, float] | None:
    """Slope, its uncertainty and the constant; None if the points are not on a line."""
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
