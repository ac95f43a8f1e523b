"""Poles shared by uniformly sampled channels: a matrix pencil in its subspace form (ESPRIT).

Hua and Sarkar, IEEE Trans. ASSP 38, 814, 1990; Roy and Kailath, IEEE Trans. ASSP 37, 984, 1989. All
channels share one Hankel matrix, so each bears on the same poles; its singular values give their
number.
"""

from __future__ import annotations

import numpy as np

from spice_models.array_types import Complexes, Floats

GONE = 1e-3  # magnitude of a pole that is gone within a sample
_LENGTH = 80  # most samples in a window
_ORDER = 24  # most real states
_WIDER = 8  # states beyond the order in a step of subspace iteration
_JUMP = 1e-4  # of the last row: below, the normal equations lose too many digits


def _lags(samples: Floats, length: int) -> Floats:
    """Return the products of samples (n, K) with those 0 to length - 1 later, (n, length)."""
    padded = np.concatenate([samples, np.zeros((length - 1, samples.shape[1]))])
    later = np.lib.stride_tricks.sliding_window_view(padded, length, axis=0)
    return np.asarray(np.matmul(samples[:, None, :], later)[:, 0])


def _grams(samples: Floats, length: int) -> tuple[Floats, ...]:
    """Return Hankel Gram matrices, (length, length), of samples (n, K).

    Of all samples, of those after the first quarter and of those before the last. An element is
    its upper left neighbour with the products of one window's samples less and of another's more.
    """
    n, quarter = samples.shape[0], samples.shape[0] // 4
    lags = _lags(samples, length)
    row = np.arange(length)
    place = np.minimum(row[:, None], row) * length + np.abs(row[:, None] - row)
    found = []
    for begin, end in ((0, n), (quarter, n), (0, n - quarter)):
        beyond = end - length + 1
        upper = np.empty((length, length))  # element j of row i is (i, i + j)
        np.sum(lags[begin:beyond], axis=0, out=upper[0])
        np.subtract(lags[beyond:end], lags[begin : begin + length - 1], out=upper[1:])
        found.append(np.cumsum(upper, axis=0).take(place))
    return tuple(found)


def _order(energy: Floats) -> int:
    """Return how many real states stand out among the Gram matrix's eigenvalues, rising."""
    length = energy.size
    size: list[float] = np.sqrt(np.maximum(energy, 0.0)).tolist()
    rest = (length + 1) // 2  # the smaller half, whose median is the noise
    noise = 0.5 * (size[(rest - 1) // 2] + size[rest // 2])
    floor = max(10 * noise, 1e-7 * size[-1])
    return min(max(sum(s > floor for s in size), 1), _ORDER, length // 3)


def _poles(basis: Floats) -> Complexes:
    """Return the poles z of a signal subspace, orthonormal columns (length, order).

    Least squares for the shift by one sample, from all rows but the last: their Gram matrix is 1
    but for the last row r, ``1 - r r'``, so its inverse is ``1 + r r' / (1 - r'r)``. A jump at
    the end of the samples leaves nothing of that denominator: seen backwards it is a pole that is
    gone at once. Poles closer to 0 than `GONE`, or beyond its inverse, are set to it.
    """
    upper, lower, last = basis[:-1], basis[1:], basis[-1]
    left = 1 - float(last @ last)
    backwards = left < _JUMP
    if backwards:
        shift = np.asarray(np.linalg.lstsq(lower, upper, rcond=None)[0], dtype=np.float64)
    else:
        shift = upper.T @ lower
        shift += np.outer(last / left, last @ shift)
    z = np.linalg.eigvals(shift).astype(np.complex128)
    z[np.abs(z) < GONE] = GONE
    return 1 / z if backwards else z


def fit_poles(samples: Floats) -> tuple[Complexes, Complexes]:
    """Return the poles z of uniformly sampled channels (n, K), and how far each of them moves.

    That is the change of log z, real and imaginary part, between the whole stretch and its first
    and its last three quarters. Their subspaces are those of the whole after a step of subspace
    iteration, in a block that is wider by some states.
    """
    length = min(samples.shape[0] // 3, _LENGTH)
    whole, *parts = _grams(samples, length)
    energy, vectors = np.linalg.eigh(whole)
    order = _order(energy)
    z = _poles(vectors[:, length - order :])
    moved = np.zeros(z.size, dtype=np.complex128)
    block = vectors[:, max(length - order - _WIDER, 0) :]
    for gram in parts:
        base = np.linalg.qr(gram @ block)[0]
        turn = np.linalg.eigh(base.T @ gram @ base)[1]
        other = _poles(base @ turn[:, -order:])
        ratio = np.log(other[np.argmin(np.abs(z[:, None] - other), axis=1)] / z)
        moved.real = np.maximum(moved.real, np.abs(ratio.real))
        moved.imag = np.maximum(moved.imag, np.abs(ratio.imag))
    return z, moved
