"""Real columns and rows in place of conjugate pairs of vectors; `real_modes` says how."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Complexes, Floats


def both(kept: NDArray[Any], real: int) -> NDArray[Any]:
    """Append the conjugates of the pairs, along the first axis."""
    return np.concatenate([kept, kept[real:].conj()])


def complex_columns(X: NDArray[Any], real: int) -> Complexes:
    """Return complex columns for real ones."""
    V, count = X.astype(np.complex128), (X.shape[1] + real) // 2
    turned = 1j * X[:, count:]
    V[:, count:] = V[:, real:count] + turned
    V[:, real:count] -= turned
    return V


def column_sizes(X: Floats, real: int) -> Floats:
    """Return the magnitudes of the complex columns for real ones."""
    squares, count = X**2, (X.shape[1] + real) // 2
    squares[:, real:count] += squares[:, count:]
    squares[:, count:] = squares[:, real:count]
    return np.asarray(np.sqrt(squares))


def row_sizes(X: Floats, real: int) -> Floats:
    """Return the magnitudes of the complex rows for real ones."""
    sizes = column_sizes(X.T, real).T
    sizes[real:] *= 0.5
    return sizes


def complex_rows(X: Floats, real: int, count: int) -> Complexes:
    """Return complex rows for real ones, without their conjugates."""
    V = X[:count].astype(np.complex128)
    V.imag[real:] = X[count:]
    V[real:] *= 0.5
    return V


def unmodal(V: Complexes, real: int, count: int) -> Floats:
    """Invert `_columns` and `_rows`."""
    first, second = V[:, real:count], V[:, count:]
    Z = np.concatenate([V[:, :real], 0.5 * (first + second), 0.5j * (first - second)], axis=1)
    X = np.concatenate([Z.real, Z.imag[real:]])
    X[real:] *= 2.0
    return np.asarray(X)


def times_poles(X: Floats, kept: Complexes, real: int) -> Floats:
    """Multiply real columns by the poles of their modes."""
    count, pairs = len(kept), kept[real:]
    Y: Floats = X * both(kept.real, real)
    Y[:, real:count] += X[:, count:] * pairs.imag
    Y[:, count:] -= X[:, real:count] * pairs.imag
    return Y
