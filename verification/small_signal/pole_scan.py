"""All crossings of the imaginary axis by poles as one value changes.

Let ``r_k`` be the k-th largest real part of all poles. Each ``r_k`` is a continuous function of the
value, and a crossing is a zero of some ``r_k``. The scan samples all poles on a grid; adds points
where an interpolated ``r_k`` might change its sign; follows the two ``r_k`` next to the axis to
their local extremes, because a crossing and its reverse may lie within one grid interval; then
brackets each change of the number of unstable poles.
"""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from spice_models.errors import EngineError, InputError, TactionError
from verification.small_signal.poles import Poles
from verification.small_signal.scan_result import AxisCrossing, Sample, Scan

TOLERANCE = 1e-8  # of a crossing's value
PASSES = (6, 4)  # halvings of a grid interval in each round
BEND = 0.5  # of the distance to the axis: largest error of interpolation without more points
REACH = 0.9  # of the distance to the axis: a parabola with its extreme beyond misses the axis
NARROW = 1e-6  # relative width below which rounding can decide the side of the axis
SAME_FREQUENCY = 1e-3  # relative difference of frequencies that count as equal

Reader = Callable[[float], Poles]


def scan(
    read: Reader, values: Sequence[float], *, logarithmic: bool = True, tolerance: float = TOLERANCE
) -> Scan:
    """Find every crossing between the least and the largest of `values`.

    Parameters
    ----------
    read : callable
        Poles at a value. If the poles are incomplete, as those of a large board, only crossings
        of the rightmost pole are listed.
    values : sequence of float
        The first grid; above zero if `logarithmic`.
    logarithmic : bool
        Whether to interpolate and halve in the logarithm of the value.
    tolerance : float
        Width of the bracket of a crossing, relative to the crossing's value (linear: relative to
        the range if the range is smaller).

    Raises
    ------
    InputError, EngineError
        No value gives poles. If only some values fail, see `Sample.failure`.

    Notes
    -----
    Costs one call of `read` per grid point, and about twenty per crossing.
    """
    search = _Search(read, values, logarithmic)
    for passes in PASSES:  # twice: a crossing may hide others in its own grid interval
        search.refine(passes)
        search.climb()
        search.close(tolerance)
    return Scan(tuple(search.samples), tuple(search.crossings()), logarithmic)


class _Search:
    """A scan in progress: samples in increasing order of the value."""

    def __init__(self, read: Reader, values: Sequence[float], logarithmic: bool) -> None:
        self.read, self.logarithmic = read, logarithmic
        self.samples: list[Sample] = []
        self._error: TactionError | None = None
        for value in sorted({float(value) for value in values}):
            self.take(math.log(value) if logarithmic else value, value)
        if self._error is not None and all(sample.failure for sample in self.samples):
            raise self._error

    def take(self, place: float, value: float | None = None) -> Sample:
        """Take one more sample and insert it in order."""
        if value is None:
            value = math.exp(place) if self.logarithmic else place
        try:
            poles = self.read(value)
            sample = Sample(place, value, poles.poles, poles.complete)
        except (InputError, EngineError) as error:
            self._error = self._error or error
            sample = Sample(place, value, np.zeros(0, dtype=np.complex128), failure=str(error))
        insort(self.samples, sample, key=lambda each: each.place)
        return sample

    def without_crossing(self) -> list[tuple[Sample, Sample, Sample]]:
        """Return neighbouring triples with equal numbers of unstable poles."""
        triples = zip(self.samples, self.samples[1:], self.samples[2:], strict=False)
        return [t for t in triples if not any(s.failure for s in t) and _equal(*t)]

    def refine(self, passes: int) -> None:
        """Halve intervals until interpolation proves that poles stay on their side of the axis."""
        for _ in range(passes):
            places = set()
            for a, m, b in self.without_crossing():
                if any(_bends(a, m, b, k) for k in _beside_the_axis(m)):
                    places |= {0.5 * (a.place + m.place), 0.5 * (m.place + b.place)}
            if not places:
                return
            for place in places:
                self.take(place)

    def climb(self) -> None:
        """Follow every pole that turns back before the axis to its point nearest the axis."""
        for triple in self.without_crossing():
            for k in _beside_the_axis(triple[1]):
                self._climb(triple, k)

    def _climb(self, triple: tuple[Sample, Sample, Sample], k: int) -> None:
        a, m, b = triple
        for step in range(60):
            near = abs(m.real(k))
            ends = abs(a.real(k)), abs(b.real(k))
            if not near < min(ends) or max(ends) == math.inf or _width(a, b) < NARROW:
                return
            top, height = _vertex(a, m, b, k)
            if step and height * np.sign(m.real(k)) > REACH * near:
                return
            sample = self.take(top)
            if sample.failure or sample.unstable != m.unstable:
                return  # a crossing: `close` brackets it
            order = sorted((a, m, b, sample), key=lambda each: each.place)
            best = min((1, 2), key=lambda i: abs(order[i].real(k)))
            a, m, b = order[best - 1 : best + 2]

    def close(self, tolerance: float) -> None:
        """Bracket every change of the number of unstable poles."""
        while wide := [pair for pair in self.changes() if _width(*pair) > tolerance]:
            self._close(*wide[0], tolerance)

    def changes(self) -> list[tuple[Sample, Sample]]:
        """Return neighbours with different numbers of unstable poles."""
        pairs = pairwise(self.samples)
        return [
            (a, b) for a, b in pairs if not (a.failure or b.failure) and a.unstable != b.unstable
        ]

    def _close(self, a: Sample, b: Sample, tolerance: float) -> None:
        """Bracket a zero of one r_k from both sides (ITP; Oliveira and Takahashi 2020)."""
        k = min(a.unstable, b.unstable)
        first = b.place - a.place
        for step in range(200):
            if _width(a, b) <= tolerance:
                return
            width, middle = b.place - a.place, 0.5 * (a.place + b.place)
            ra, rb = a.real(k), b.real(k)
            chord = (a.place * rb - b.place * ra) / (rb - ra) if math.isfinite(rb - ra) else middle
            push = math.copysign(min(0.2 / first * width**2, abs(middle - chord)), middle - chord)
            least = 0.25 * width * tolerance / _width(a, b)
            shifted = chord + math.copysign(max(abs(push), min(least, abs(middle - chord))), push)
            slack = max(first * 2.0 ** (1 - step) - 0.5 * width, 0.0)
            place = min(max(shifted, middle - slack), middle + slack)
            sample = self.take(place)
            if sample.failure:
                return
            a, b = (sample, b) if (sample.real(k) >= 0.0) == (ra >= 0.0) else (a, sample)

    def crossings(self) -> list[AxisCrossing]:
        """Return the crossings; changes closer than `NARROW` count as one change."""
        clusters: list[tuple[Sample, Sample]] = []
        for a, b in self.changes():
            if clusters and _width(clusters[-1][0], b) < NARROW:
                clusters[-1] = (clusters[-1][0], b)
            else:
                clusters.append((a, b))
        return [c for a, b in clusters if a.unstable != b.unstable for c in _between(a, b)]


def _width(a: Sample, b: Sample) -> float:
    return (b.value - a.value) / max(abs(a.value), abs(b.value))


def _between(a: Sample, b: Sample) -> list[AxisCrossing]:
    less, more = sorted((a, b), key=lambda each: each.unstable)
    crossed = more.poles[less.unstable : more.unstable]
    frequencies: list[float] = []
    for omega in sorted(np.abs(crossed.imag).tolist()):
        if not frequencies or omega > (1.0 + SAME_FREQUENCY) * frequencies[-1]:
            frequencies.append(omega)
    k = less.unstable
    ra, rb = a.real(k), b.real(k)
    share = ra / (ra - rb) if math.isfinite(ra - rb) else 0.5
    value = a.value + share * (b.value - a.value)
    return [
        AxisCrossing(value, w / (2.0 * math.pi), b is more, a.unstable, b.unstable)
        for w in frequencies
    ]


def _equal(*samples: Sample) -> bool:
    return len({sample.unstable for sample in samples}) == 1


def _beside_the_axis(sample: Sample) -> tuple[int, ...]:
    """Return the indices of the last unstable and the first stable pole, from the right."""
    count = sample.unstable
    return tuple(k for k in (count - 1, count) if 0 <= k < sample.known)


def _bends(a: Sample, m: Sample, b: Sample, k: int) -> bool:
    share = (m.place - a.place) / (b.place - a.place)
    chord = (1.0 - share) * a.real(k) + share * b.real(k)
    nearest = min(abs(each.real(k)) for each in (a, m, b))
    return math.isfinite(chord) and abs(m.real(k) - chord) > BEND * nearest


def _vertex(a: Sample, m: Sample, b: Sample, k: int) -> tuple[float, float]:
    """Return place and height of the extreme of the parabola through three points."""
    left, right = m.place - a.place, b.place - m.place
    down, up = (m.real(k) - a.real(k)) / left, (b.real(k) - m.real(k)) / right
    curvature = (up - down) / (left + right)
    slope = (down * right + up * left) / (left + right)
    offset = -0.5 * slope / curvature if curvature else 0.0
    height = m.real(k) + offset * slope + offset**2 * curvature
    least = 0.05 * (right if offset >= 0.0 else left)
    if abs(offset) < least:  # a new point too near m would not shrink the bracket
        offset = math.copysign(least, offset if offset else right - left)
    return m.place + offset, height
