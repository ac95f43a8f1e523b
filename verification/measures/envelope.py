"""The envelope of a ringing over a whole record, and whether it saturates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Complexes, Floats
from verification.measures.resampling import pace, resample

_POINTS = 8192  # most samples of a record
_BLOCK = 16384  # samples of some channels that are worked on together: they stay in the cache
_FEWEST = 64
_ENOUGH, _PLENTY = 20.0, 40.0  # samples a period: to be reached; to be kept when thinning out
_CHUNKS = 64
_WEAK = 0.1  # of a strong line: below, a line at a third of its frequency is no fundamental
_TONE = 0.1  # of a peak: beyond, its neighbours are not those of a tone


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


def spectrum(y: Floats) -> Complexes:
    """Return the spectrum of the difference of y (n,) under a Hann window.

    Line k of the m + 1 is k periods in the last 2 m steps; 2 m is at least 15/16 of all, without
    large prime factors. The difference keeps a slow tail from hiding the ringing; a second one
    would favour a square wave's harmonics over its fundamental.
    """
    slope = np.diff(y)
    lines = np.fft.rfft(slope[slope.size % max(1 << max(slope.size.bit_length() - 5, 0), 2) :])
    # The Hann window as what it does to the lines: half of both neighbours is subtracted.
    around = np.concatenate([lines[1:2].conj(), lines, lines[-2:-1].conj()])
    return np.asarray(lines - 0.5 * (around[2:] + around[:-2]))


def _fundamental(size: Floats, k: int) -> int:
    """Return the line that line k is an odd harmonic of, or k.

    Clipping starts the odd harmonics of a wave. Between channels of either sign or of several
    phases, their fundamental may cancel more than they do.
    """
    for odd in (9, 7, 5, 3):
        low = max(round(k / odd) - 1, 3)
        j = low + int(size[low : low + 3].argmax())
        if odd * low < k and size[j] >= max(_WEAK * size[k], size[j - 1], size[j + 1]):
            return j
    return k


def _offset(left: complex, top: complex, right: complex) -> float:
    """Return how far a peak lies beyond its line, in lines, by that line and its neighbours.

    A tone, decaying or not, is 1 / (j - c) in line j without a window, c its complex frequency;
    with second differences in their place the lines tell c and whether they are those of a tone.
    A ringing that starts or clips on the way is none, but as its envelope is real, the magnitudes
    fall alike on either side: that of the window's main lobe is nearly a parabola in logarithms.
    """
    bend = left - 2 * top + right
    if abs(bend) > abs(top):  # at least three times for a tone
        off = 2 * (right - left) / bend
        if abs(right * (2 - off) + top * (1 + off)) < _TONE * abs(top):
            return min(max(off.real, -1.0), 1.0)
    a, b, c = (math.log(max(abs(line), 1e-300)) for line in (left, top, right))
    return min(max(0.5 * (a - c) / min(a - 2 * b + c, -1e-3), -1.0), 1.0)


def _dominant_period(y: Floats, step: float, most: int) -> float | None:
    """Return the period of the lowest strong line of the first `most`, or None; a hump is none."""
    lines = spectrum(y)
    size = np.abs(lines[:most])
    inner = size[1:-1]
    strong = (inner >= size[:-2]) & (inner >= size[2:]) & (inner > 0.6 * size.max())
    k = _fundamental(size, int(np.argmax(strong)) + 1)
    if k < 3 or 2 * k >= size.size or max(size[k // 2], size[2 * k]) > 0.5 * size[k]:
        return None
    return 2 * (lines.size - 1) * step / (k + _offset(*lines[k - 1 : k + 2].tolist()))


def _without_trend(y: Floats, window: float) -> Floats:
    """Subtract the mean over one period from y (K, n), and trim the ends.

    `window` is any real number of samples; y is linear between them.
    """
    whole, part = divmod(0.5 * window, 1.0)
    reach = int(whole) + 1
    kept = y.shape[1] - 2 * reach
    late, last = slice(2 * reach - 1, -1), slice(2 * reach, None)
    early, first = slice(1, kept + 1), slice(kept)
    total = np.cumsum(y, axis=1)
    area = total[:, late] - total[:, first]
    ends = y[:, late] + y[:, early]
    ends *= -0.5 * (1 - part) ** 2
    area += ends
    np.add(y[:, last], y[:, first], out=ends)
    ends *= 0.5 * part**2
    area += ends
    area /= -window
    area += y[:, reach:-reach]
    return area


def _swing(ringing: Floats, size: int, window: float) -> Floats:
    """Return half of peak to peak, (K, chunks), of chunks of `size` steps up to the last sample.

    A parabola through the highest sample and its neighbours finds the peak between samples. It
    rises no further than a sinusoid of `window` samples a period can, so a corner gains little.
    """
    channels, n = ringing.shape
    begin = np.arange((n - 1) % size, n - 1, size) + n * np.arange(channels)[:, None]
    chunks = np.lib.stride_tricks.sliding_window_view(ringing, size + 1, axis=1)
    chunks = chunks[:, (n - 1) % size :: size]
    half, rise = np.zeros((2, *begin.shape))
    for sign, place in ((0.5, chunks.argmax(axis=2)), (-0.5, chunks.argmin(axis=2))):
        at = begin + place
        top = sign * ringing.take(at)
        fall_l = top - sign * ringing.take(at - 1, mode="clip")
        fall_r = top - sign * ringing.take(at + 1, mode="clip")
        peak = (fall_l >= 0) & (fall_r >= 0) & (fall_l + fall_r > 0)
        rise += np.where(peak, (fall_l - fall_r) ** 2 / (8 * np.where(peak, fall_l + fall_r, 1)), 0)
        half += top
    most = half * (1 - np.cos(np.pi / window))
    return np.asarray(half + np.minimum(rise, most), dtype=np.float64)


def envelope(time: Floats, signals: Floats) -> Envelope:
    """Return the ringing amplitude of each channel over the record.

    Parameters
    ----------
    time : ndarray (P,)
        Strictly increasing, s.
    signals : ndarray (P, K)
        Finite.
    """
    n, span = time.size, float(time[-1] - time[0])
    usual = pace(time)
    end = max(n - 4, 0)  # a simulator cuts its last steps to meet the stop time
    # Chords between few points would add a ringing of their own.
    points = 6 if n < _POINTS // 2 else 2
    coarsest = usual * np.ceil(span / usual / _POINTS)
    step = coarsest if span > _FEWEST * usual else usual / np.ceil(_FEWEST * usual / span)
    at, one = resample(time, mixed(signals)[:, None], step, usual, end, _POINTS, points)
    half, whole = one[one.size // 2 :, 0], one[:, 0]
    most = _POINTS // 4
    period = _dominant_period(half, step, most // 2) or _dominant_period(whole, step, most)
    if period is None:
        return Envelope(at.mean(keepdims=True), np.zeros((1, signals.shape[1])), None)
    own = period / usual
    refined = 1 / np.ceil(_ENOUGH / own) if own < _ENOUGH else max(int(own / _PLENTY), 1)
    step = max(usual * refined, coarsest)
    at, uniform = resample(time, signals, step, usual, end, _POINTS, points)
    window = period / step
    trim = int(0.5 * window) + 1
    chunks = int(np.clip(span / (1.25 * period) - 1, 1, _CHUNKS))
    size = (at.size - 2 * trim - 1) // chunks
    together = max(_BLOCK // at.size, 1)
    swings = [
        _swing(_without_trend(uniform[:, some : some + together].T.copy(), window), size, window)
        for some in range(0, signals.shape[1], together)
    ]
    middle = at[at.size - 1 - trim] - step * size * (np.arange(chunks, 0, -1) - 0.5)
    return Envelope(middle, np.concatenate(swings)[:, -chunks:].T, period)


def saturates(amplitude: Floats) -> bool:
    """Tell whether an envelope (M,) grew at least threefold and then stopped growing.

    Its last fifth keeps within 5 per cent, or within 15 if it varies from chunk to chunk only: few
    points a period leave the peaks of a clipped wave uncertain.
    """
    last = amplitude[-max(amplitude.size // 5, 2) :]
    if amplitude.size < 8 or last.min() <= 0:
        return False
    end, half = float(last.mean()), last.size // 2
    drift = abs(float(last[-half:].mean() - last[:half].mean()))
    jagged = float(np.abs(np.diff(last, 2)).mean()) if last.size > 4 else 0.0
    spread = min(0.05 * end + jagged, 0.15 * end)
    return bool(amplitude.min() < end / 3 and np.ptp(last) < spread and drift < 0.05 * end)


def slows(amplitude: Floats) -> int:
    """Return how many chunks precede the last fourfold growth of an envelope (M,) that slows, or 0.

    That is when it grows less than half as fast in its last sixteenth as just before that growth.
    """
    first = int(np.argmax(amplitude > 0.25 * amplitude[-1]))
    if first < 2 or amplitude.min() <= 0:
        return 0
    growth = np.diff(np.log(amplitude))
    before = growth[max(2 * first - amplitude.size, 0) : first]
    late = growth[-max(amplitude.size // 16, 2) :]
    return first if late.mean() < 0.5 * before.mean() else 0
