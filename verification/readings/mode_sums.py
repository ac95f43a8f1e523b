"""Functions of modes over time, none of which overflows: steps, integrals, exponentials, sums."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from taction.system.array_types import Complexes, Floats

Array = TypeVar("Array", Floats, Complexes)

TINY = 1e-280  # in the place of zero
LARGEST = 300.0  # exponent


def slip(step: Floats, poles: Complexes) -> Complexes:
    """Return ``(log((1 + z) / (1 - z)) - 2 z) / step`` with ``z = step poles / 2``, Im z >= 0.

    Functions of real numbers take a third of the time of a complex logarithm. A step of exactly
    ``-2 / p`` removes a mode p; its logarithm is limited to that of `TINY`.
    """
    x, y = 0.5 * step * poles.real, 0.5 * step * poles.imag
    square = y * y
    before, after = (1.0 + x) ** 2 + square, (1.0 - x) ** 2 + square
    decay = 0.5 * np.log(np.maximum(before / after, TINY)) - 2.0 * x
    turn = np.arctan2(2.0 * y, 1.0 - x * x - square) - 2.0 * y
    return np.asarray((decay + 1j * turn) / step)


def integral(rate: Array, time: Floats) -> Array:
    """Integrate `rate`, (T,) or (T, n), over `time` by the trapezoidal rule; the same shape."""
    found = np.zeros_like(rate)
    between = np.diff(time) if rate.ndim == 1 else np.diff(time)[:, None]
    np.cumsum(0.5 * (rate[1:] + rate[:-1]) * between, axis=0, out=found[1:])
    return found


def limited_exp(exponents: Complexes) -> Complexes:
    """Return the exponential, limited to ``exp(LARGEST)``."""
    return np.asarray(np.exp(np.minimum(exponents.real, LARGEST) + 1j * exponents.imag))


def real_magnitude(growth: Complexes, shares: Complexes) -> Floats:
    """Return ``|Re(growth @ shares)|``, computed in real arithmetic."""
    return np.abs(growth.real @ shares.real - growth.imag @ shares.imag)
