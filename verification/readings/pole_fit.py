"""Poles shared by uniformly sampled channels: a matrix pencil in its subspace form (ESPRIT).

Hua and Sarkar, IEEE Trans. ASSP 38, 814, 1990; Roy and Kailath, IEEE Trans. ASSP 37, 984, 1989. All
channels share one Hankel matrix, so all contribute to the same poles; its singular values give the
number of poles.
"""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Complexes, Floats

GONE = 1e-3  # magnitude of a pole that decays within one sample
_MOST_LENGTH = 80  # samples in a window
_MOST_STATES = 24  # real states
_EXTRA_STATES = 8  # states beyond the order in a step of subspace iteration
_LEAST_DENOMINATOR = 1e-4  # below, the normal equations lose too many digits


def _lags(samples: Floats, length: int) -> Floats:
    """Return products of samples (n, K) with samples 0 to length - 1 later, (n, length)."""
    padded = np.concatenate([samples, np.zeros((length - 1, samples.shape[1]))])
    later = np.lib.stride_tricks.sliding_window_view(padded, length, axis=0)
    return np.asarray(np.matmul(samples[:, None, :], later)[:, 0])


def _grams(samples: Floats, length: int) -> tuple[Floats, ...]:
    """Return Hankel Gram matrices of samples (n, K): of all, of the last and first 3/4."""
    # An element is its upper left neighbour minus the product that leaves the window, plus the
    # product that enters.
    n, quarter = samples.shape[0], samples.shape[0] // 4
    lags = _lags(samples, length)
    row = np.arange(length)
    place = np.minimum(row[:, None], row) * length + np.abs(row[:, None] - row)
    grams = []
    for begin, end in ((0, n), (quarter, n), (0, n - quarter)):
        beyond = end - length + 1
        upper = np.empty((length, length))  # element j of row i is (i, i + j)
        np.sum(lags[begin:beyond], axis=0, out=upper[0])
        np.subtract(lags[beyond:end], lags[begin : begin + length - 1], out=upper[1:])
        grams.append(np.cumsum(upper, axis=0).take(place))
    return tuple(grams)


def _order(energy: Floats) -> int:
    """Return the number of real states: of eigenvalues (rising) of the Gram matrix above noise."""
    length = energy.size
    size: list[float] = np.sqrt(np.maximum(energy, 0.0)).tolist()
    noise = float(np.median(size[: (length + 1) // 2]))
    floor = max(10 * noise, 1e-7 * size[-1])
    return min(max(sum(s > floor for s in size), 1), _MOST_STATES, length // 3)


def _poles(basis: Floats) -> Complexes:
    """Return the poles z of a signal subspace, orthonormal columns (length, order).

    Poles closer to 0 than `GONE`, or beyond its inverse, are set to that limit.
    """
    # Least squares for the shift by one sample, from all rows except the last row r: their Gram
    # matrix is ``1 - r r'``, its inverse ``1 + r r' / (1 - r'r)``. For a jump at the end of the
    # samples the denominator vanishes; backwards in time the jump is a pole that decays at once.
    upper, lower, last = basis[:-1], basis[1:], basis[-1]
    denominator = 1 - float(last @ last)
    backwards = denominator < _LEAST_DENOMINATOR
    if backwards:
        shift = np.asarray(np.linalg.lstsq(lower, upper, rcond=None)[0], dtype=np.float64)
    else:
        shift = upper.T @ lower
        shift += np.outer(last / denominator, last @ shift)
    z = np.linalg.eigvals(shift).astype(np.complex128)
    z[np.abs(z) < GONE] = GONE
    return 1 / z if backwards else z


def fit_poles(samples: Floats) -> tuple[Complexes, Complexes]:
    """Return the poles z of uniformly sampled channels (n, K), and how far each pole moves.

    The movement is the change of log z, real and imaginary part, between a fit to all samples and
    fits to the first and to the last three quarters. One step of subspace iteration, in a block
    that is wider by some states, gives the subspaces of the parts.
    """
    length = min(samples.shape[0] // 3, _MOST_LENGTH)
    whole, *parts = _grams(samples, length)
    energy, vectors = np.linalg.eigh(whole)
    order = _order(energy)
    z = _poles(vectors[:, length - order :])
    moved = np.zeros(z.size, dtype=np.complex128)
    block = vectors[:, max(length - order - _EXTRA_STATES, 0) :]
    for gram in parts:
        base = np.linalg.qr(gram @ block)[0]
        turn = np.linalg.eigh(base.T @ gram @ base)[1]
        other = _poles(base @ turn[:, -order:])
        ratio = np.log(other[np.argmin(np.abs(z[:, None] - other), axis=1)] / z)
        moved.real = np.maximum(moved.real, np.abs(ratio.real))
        moved.imag = np.maximum(moved.imag, np.abs(ratio.imag))
    return z, moved
