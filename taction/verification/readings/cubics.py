"""Cubics through values and slopes at both ends of intervals: their ranges."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats

SLACK = 0.05  # of the smaller slope times the width, where an interval rises and then falls: the
# tangents meet at most so far above the ends, and a resolved cubic's top errs by 0.0013 of that


def cubic_ranges(
    here: Floats, after: Floats, rise: Floats, fall: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """Return the largest values (Q, N) of cubics and of their negatives.

    The cubics have values and slopes at the ends of intervals of a `width` (Q, 1).

    Examples
    --------
    >>> parabola = np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)), -np.ones((1, 1))
    >>> [abs(values).tolist() for values in cubic_ranges(*parabola, np.ones((1, 1)))]
    [[[0.25]], [[0.0]]]
    """
    first, last, delta = rise * width, fall * width, after - here
    square, cube = 3.0 * delta - 2.0 * first - last, first + last - 2.0 * delta
    root = np.sqrt(np.maximum(square**2 - 3.0 * cube * first, 0.0))
    tops = []
    for sign in (1.0, -1.0):
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.fmin(np.fmax(first / (sign * root - square), 0.0), 1.0)
        peak = sign * (here + at * (first + at * (square + at * cube)))
        tops.append(np.maximum(np.maximum(sign * here, sign * after), peak))
    high, low = tops
    return high, low
