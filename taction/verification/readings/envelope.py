"""Envelope of the ringing over a record, and its saturation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.verification.readings.signals import resample, typical_step

_MOST_SAMPLES = 8192  # of a record
_FEWEST_SAMPLES = 64
_BLOCK = 16384  # samples that are processed together: they fit into the cache
_LEAST_DENSITY, _KEPT_DENSITY = 20.0, 40.0  # samples a period: least, and least after thinning
_CHUNKS = 64
_WEAK = 0.1  # of a strong line: a weaker line at a third of its frequency is no fundamental
_TONE = 0.1  # largest misfit of a tone to three lines, over the middle line


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """Ringing amplitude over time."""

    time: Floats  # middle of each chunk (M,), s
    amplitude: Floats  # half of peak to peak in each chunk (M, K), without the mean over a period
    period: float | None  # s; None, and `amplitude` 0, if no ringing lasts three periods


def mixed(signals: Floats) -> Floats:
    """Return one weighted sum (P,) of the signals, in which no symmetry cancels a mode."""
    weights = np.cos(np.arange(1.0, signals.shape[1] + 1))
    return np.asarray(signals @ weights, dtype=np.float64)


def spectrum(y: Floats) -> Complexes:
    """Return the spectrum, (m + 1,), of the difference of y (n,) under a Hann window.

    Line k has k periods in the last 2 m steps; 2 m is at least 15/16 of all steps, without large
    prime factors. The difference keeps a slow tail from hiding the ringing; a second difference
    would favour a square wave's harmonics over its fundamental.
    """
    slope = np.diff(y)
    lines = np.fft.rfft(slope[slope.size % max(1 << max(slope.size.bit_length() - 5, 0), 2) :])
    # A Hann window subtracts half of both neighbours from every line.
    around = np.concatenate([lines[1:2].conj(), lines, lines[-2:-1].conj()])
    return np.asarray(lines - 0.5 * (around[2:] + around[:-2]))


def _fundamental(size: Floats, k: int) -> int:
    """Return the fundamental of which line k is an odd harmonic, or k."""
    # A clipped wave has odd harmonics. In a sum of channels with different signs or phases the
    # fundamental may cancel more than its harmonics.
    for odd in (9, 7, 5, 3):
        low = max(round(k / odd) - 1, 3)
        j = low + int(size[low : low + 3].argmax())
        if odd * low < k and size[j] >= max(_WEAK * size[k], size[j - 1], size[j + 1]):
            return j
    return k


def _offset(left: complex, top: complex, right: complex) -> float:
    """Return the distance of a peak from its line, in lines, from that line and its neighbours."""
    # Without a window, a tone of complex frequency c is 1 / (j - c) in line j. The windowed lines
    # are second differences of such values: they determine c, and whether they belong to a tone.
    curvature = left - 2 * top + right
    if abs(curvature) > abs(top):  # at least three times as large for a tone
        offset = 2 * (right - left) / curvature
        if abs(right * (2 - offset) + top * (1 + offset)) < _TONE * abs(top):
            return min(max(offset.real, -1.0), 1.0)
    # A ringing that starts or clips within the record is not a tone, but its envelope is real, so
    # the logarithms of the magnitudes are nearly a parabola around the peak.
    a, b, c = (math.log(max(abs(line), 1e-300)) for line in (left, top, right))
    return min(max(0.5 * (a - c) / min(a - 2 * b + c, -1e-3), -1.0), 1.0)


def _dominant_period(y: Floats, step: float, most: int) -> float | None:
    """Return the period of the lowest strong peak among the first `most` lines, or None."""
    lines = spectrum(y)
    size = np.abs(lines[:most])
    inner = size[1:-1]
    strong = (inner >= size[:-2]) & (inner >= size[2:]) & (inner > 0.6 * size.max())
    k = _fundamental(size, int(np.argmax(strong)) + 1)
    if k < 3 or 2 * k >= size.size or max(size[k // 2], size[2 * k]) > 0.5 * size[k]:
        return None
    return 2 * (lines.size - 1) * step / (k + _offset(*lines[k - 1 : k + 2].tolist()))


def _without_trend(y: Floats, window: float) -> Floats:
    """Subtract the mean over one period of `window` samples from y (K, n), and trim the ends."""
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


def _half_peak_to_peak(ringing: Floats, size: int, window: float) -> Floats:
    """Return half of peak to peak, (K, chunks), of chunks of `size` steps up to the last sample."""
    # A parabola through the highest sample and its neighbours estimates the peak. Its rise is
    # limited to that of a sinusoid of `window` samples a period, so a corner adds little.
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
    typical = typical_step(time)
    end = max(n - 4, 0)  # a simulator shortens its last steps to end at the stop time
    # Linear interpolation between few points would add ringing.
    points = 6 if n < _MOST_SAMPLES // 2 else 2
    coarsest = typical * np.ceil(span / typical / _MOST_SAMPLES)
    short = span <= _FEWEST_SAMPLES * typical
    step = typical / np.ceil(_FEWEST_SAMPLES * typical / span) if short else coarsest
    at, one = resample(time, mixed(signals)[:, None], step, typical, end, _MOST_SAMPLES, points)
    half, whole = one[one.size // 2 :, 0], one[:, 0]
    most = _MOST_SAMPLES // 4
    period = _dominant_period(half, step, most // 2) or _dominant_period(whole, step, most)
    if period is None:
        return Envelope(at.mean(keepdims=True), np.zeros((1, signals.shape[1])), None)
    density = period / typical
    if density < _LEAST_DENSITY:
        step = max(typical * (1 / np.ceil(_LEAST_DENSITY / density)), coarsest)
    else:
        step = max(typical * max(int(density / _KEPT_DENSITY), 1), coarsest)
    at, uniform = resample(time, signals, step, typical, end, _MOST_SAMPLES, points)
    window = period / step
    trim = int(0.5 * window) + 1
    chunks = int(np.clip(span / (1.25 * period) - 1, 1, _CHUNKS))
    size = (at.size - 2 * trim - 1) // chunks
    together = max(_BLOCK // at.size, 1)
    blocks = (uniform[:, n : n + together].T.copy() for n in range(0, signals.shape[1], together))
    halves = [_half_peak_to_peak(_without_trend(y, window), size, window) for y in blocks]
    middle = at[at.size - 1 - trim] - step * size * (np.arange(chunks, 0, -1) - 0.5)
    return Envelope(middle, np.concatenate(halves)[:, -chunks:].T, period)


def saturates(amplitude: Floats) -> bool:
    """Tell whether an envelope (M,) grew at least threefold and then stopped growing.

    The last fifth varies by less than 5 per cent, or by less than 15 per cent if it varies only
    from chunk to chunk: with few points a period the peaks of a clipped wave are uncertain.
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
    """Return how many chunks precede the last fourfold growth of an envelope (M,), if that slows.

    The growth slows if its rate in the last sixteenth is less than half of the rate just before
    the fourfold growth; 0 if it does not slow.
    """
    first = int(np.argmax(amplitude > 0.25 * amplitude[-1]))
    if first < 2 or amplitude.min() <= 0:
        return 0
    growth = np.diff(np.log(amplitude))
    before = growth[max(2 * first - amplitude.size, 0) : first]
    late = growth[-max(amplitude.size // 16, 2) :]
    return first if late.mean() < 0.5 * before.mean() else 0
