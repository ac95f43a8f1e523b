"""Cubics through values and slopes at both ends of intervals: ranges, upper bounds."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats

SLACK = 0.1  # of the height of the tangents above the ends; a cubic's top errs by 0.0013 of it
STEEP = 0.25  # of the slopes times the width: above 4/27, the most of a cubic, and `SLACK`


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


def _summit(here: Floats, after: Floats, rise: Floats, fall: Floats, width: Floats) -> Floats:
    """Return the values at the local maxima of cubics, or at an end where there is none."""
    first, last, delta = rise * width, fall * width, after - here
    square, cube = 3.0 * delta - 2.0 * first - last, first + last - 2.0 * delta
    root = np.sqrt(np.maximum(square**2 - 3.0 * cube * first, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.fmin(np.fmax(first / (root - square), 0.0), 1.0)
    return np.asarray(here + at * (first + at * (square + at * cube)))


def upper_bounds(here: Floats, after: Floats, rise: Floats, fall: Floats, width: Floats) -> Floats:
    """Return upper bounds (Q, N) of a signal in intervals, from values and slopes at their ends.

    Between a rising and a falling end: the top of the cubic through both, and `SLACK` of the height
    of the tangents' intersection above the ends.

    Examples
    --------
    >>> parabola = np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)), -np.ones((1, 1))
    >>> upper_bounds(*parabola, np.ones(1)).tolist()
    [[0.3]]
    """
    top = np.maximum(here, after)
    row, column = np.nonzero((rise > 0.0) & (fall < 0.0))
    if row.size:
        y, z, up, down = (end[row, column] for end in (here, after, rise, fall))
        span = width[row]
        first, last = up * span, down * span
        meet = y + first * np.clip((z - y - last) / (first - last), 0.0, 1.0)
        high = top[row, column]
        peak = np.maximum(_summit(y, z, up, down, span), high)
        top[row, column] = peak + SLACK * np.maximum(meet - high, 0.0)
    return top
