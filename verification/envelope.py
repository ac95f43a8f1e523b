"""The envelope of a ringing over a whole record, and whether it saturates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verification.crossings import lagrange
from verification.waveforms import Floats

_POINTS = 8192
_CHUNKS = 64


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """Ringing amplitude over time.

    Attributes
    ----------
    time : ndarray (M,)
        Middle of each chunk, s.
    amplitude : ndarray (M, K)
        Half of peak to peak in each chunk, the mean over one period removed.
    period : float or None
        Dominant ringing period, s; None when nothing rings for three periods or more, and
        `amplitude` is then zero.
    """

    time: Floats
    amplitude: Floats
    period: float | None


def mixed(signals: Floats) -> Floats:
    """Return one signal (P,) in which no symmetry cancels a mode."""
    weights = np.cos(np.arange(1.0, signals.shape[1] + 1))
    return np.asarray(signals @ weights, dtype=np.float64)


def spectrum(y: Floats) -> Floats:
    """Return the magnitude spectrum of the difference under a Hann window, shape (n // 2,).

    The difference keeps a slow tail from hiding the ringing; a second one would favour a square
    wave's harmonics over its fundamental.
    """
    slope = np.diff(y)
    return np.abs(np.fft.rfft(slope * np.hanning(slope.size)))


def _dominant_period(y: Floats, span: float) -> float | None:
    """Return the period of the lowest strong spectral line, or None; a hump is no ringing."""
    usable = spectrum(y)[: y.size // 4]
    inner = usable[1:-1]
    lines = (inner >= usable[:-2]) & (inner >= usable[2:]) & (inner > 0.6 * usable.max())
    k = int(np.argmax(lines)) + 1  # a square wave's harmonics are as strong as its fundamental
    if k < 3 or 2 * k >= usable.size or max(usable[k // 2], usable[2 * k]) > 0.5 * usable[k]:
        return None
    left, top, right = np.log(np.maximum(usable[k - 1 : k + 2], 1e-300))
    return span / (k + 0.5 * float(left - right) / min(float(left - 2 * top + right), -1e-3))


def _without_trend(y: Floats, window: float) -> Floats:
    """Subtract the mean over one period, `window` points (any real number), and trim the ends."""
    whole, part = divmod(0.5 * window, 1.0)
    reach = int(whole) + 1
    total = np.concatenate([np.zeros_like(y[:1]), np.cumsum(0.5 * (y[1:] + y[:-1]), axis=0)])
    n = y.shape[0] - 2 * reach
    ahead = (1 - part) * total[2 * reach - 1 : -1] + part * total[2 * reach :]
    behind = (1 - part) * total[1 : n + 1] + part * total[:n]
    return y[reach:-reach] - (ahead - behind) / window


def envelope(time: Floats, signals: Floats) -> Envelope:
    """Return the ringing amplitude of each channel over the record.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s.
    signals : ndarray (P, K)
        Finite.
    """
    n = int(min(max(2 * time.size, 64), _POINTS))
    grid = np.linspace(time[0], time[-1], n)
    if time.size < _POINTS // 2:  # chords between few points would add a ringing of their own
        uniform = lagrange(time, signals, grid, 6)
    else:
        uniform = np.column_stack([np.interp(grid, time, column) for column in signals.T])
    span = float(time[-1] - time[0])
    one = mixed(uniform)
    period = _dominant_period(one[n // 2 :], span / 2) or _dominant_period(one, span)
    if period is None:
        return Envelope(grid.mean(keepdims=True), np.zeros((1, signals.shape[1])), None)
    ringing = _without_trend(uniform, period / span * (n - 1))
    trim = (n - ringing.shape[0]) // 2
    chunks = int(np.clip(span / (1.25 * period) - 1, 1, _CHUNKS))
    size = ringing.shape[0] // chunks
    ends = slice(ringing.shape[0] - size * chunks, None)
    pieces = ringing[ends].reshape(chunks, size, -1)
    middle = grid[trim : n - trim][ends].reshape(chunks, size).mean(axis=1)
    return Envelope(middle, 0.5 * (pieces.max(axis=1) - pieces.min(axis=1)), period)


def saturates(amplitude: Floats) -> bool:
    """Tell whether an envelope (M,) grew at least threefold and then stopped growing."""
    last = amplitude[-max(amplitude.size // 5, 2) :]
    if amplitude.size < 8 or last.min() <= 0:
        return False
    return bool(amplitude.min() < last.mean() / 3 and np.ptp(last) < 0.05 * last.mean())
