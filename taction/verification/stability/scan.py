"""All edges of stability over one value, from poles at samples of the value.

The scan samples all poles on a grid and follows each from value to value. It adds points where the
real part of a pole might change its sign, and climbs to the place where a pole comes nearest to
the axis, because a crossing and its reverse may lie within one grid interval. Then it brackets each
change of the number of unstable poles: the k-th largest real part ``r_k`` is a continuous function
of the value, and a crossing is a zero of some ``r_k``.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.system.errors import TactionError
from taction.verification.stability.edges import Edge, Sample, Scan
from taction.verification.stability.poles import Poles

TOLERANCE = 1e-8  # of a crossing's value
PASSES = (6, 4)  # halvings of a grid interval in each round
BEND = 0.5  # of the distance to the axis: largest error of interpolation without more points
REACH = 0.9  # of the distance to the axis: a parabola with its extreme beyond misses the axis
NARROW = 1e-6  # relative width below which rounding can decide the side of the axis
SAME_FREQUENCY = 1e-3  # relative difference of frequencies that count as equal
AHEAD = 4  # values at once on the way from a stable board to the next edge

Answer = Poles | TactionError
Read = Callable[[list[float]], Sequence[Answer]]
"""Returns the poles at some values, or why there are none."""
Triple = tuple[Sample, Sample, Sample]
Followed = tuple[complex, complex, complex]  # one pole in three samples


def scan(
    values: Sequence[float],
    read: Read,
    *,
    logarithmic: bool = True,
    tolerance: float = TOLERANCE,
    fine: bool = True,
    start: float | None = None,
) -> Scan:
    """Find every edge between the least and the largest of `values`.

    If the poles are incomplete, as those of a large board, only crossings of the rightmost pole are
    listed.

    Parameters
    ----------
    values : sequence of float
        The first grid; above zero if `logarithmic`.
    read : callable
        Returns the poles at some values.
    logarithmic : bool
        Whether to interpolate and halve in the logarithm of the value.
    tolerance : float
        Width of the bracket of a crossing, relative to the crossing's value (linear: relative to
        the range if the range is smaller).
    fine : bool
        Whether to look between the values, too. If not, only the edges at which the board becomes
        stable or unstable are found, and a range narrower than the steps of `values` may be missed.
    start : float, optional
        The least or the largest of `values`, of a stable board, if only the edge next to it is
        wanted: the scan goes no further than the first value of a board that is certainly unstable.

    Raises
    ------
    InputError, EngineError
        No value gives poles. If only some values fail, see `Sample.failure`.

    Notes
    -----
    Costs the poles of one board per grid point, and about twenty per crossing.

    Examples
    --------
    >>> from taction.verification.stability.poles import summarise
    >>> def read(values):
    ...     return [summarise(np.array([v - 3 + 0j, -9.0]), complete=True) for v in values]
    >>> [edge.value for edge in scan([1.0, 5.0], read).edges]
    [3.0]
    """
    search = _Search(read, logarithmic, None if fine else 0)
    search.begin(values, start)
    for passes in PASSES if fine else ():  # twice: an edge may hide others in its grid interval
        search.refine(passes)
        search.climb()
        search.close(tolerance)
    search.close(tolerance)
    samples = tuple(search.samples)
    failed = tuple(sample.value for sample in samples if sample.failure)
    ends, lowest = (samples[0].value, samples[-1].value), samples[0].unstable
    found = Scan(*ends, tuple(search.edges()), failed, lowest, samples, logarithmic)
    hidden = {value for ends in found.unresolved for value in ends}
    return replace(found, near=tuple(sorted({*failed, *hidden})))


class _Search:
    """A scan in progress: samples in increasing order of the value.

    Edges with more than `most` unstable poles on both sides are left out.
    """

    def __init__(self, read: Read, logarithmic: bool, most: int | None) -> None:
        self.read, self.logarithmic, self.most = read, logarithmic, most
        self.samples: list[Sample] = []

    def begin(self, values: Sequence[float], start: float | None) -> None:
        """Take the samples of the first grid; raise an error if none of them has poles."""
        ordered = sorted({float(value) for value in values}, reverse=start == max(values))
        step, errors = len(ordered) if start is None else AHEAD, list[TactionError]()
        for first in range(0, len(ordered), step):
            some = ordered[first : first + step]
            for value, found in zip(some, self.read(some), strict=True):
                errors += [found] if isinstance(found, TactionError) else []
                place = math.log(value) if self.logarithmic else value
                there = self._insert(place, value, found)
                if start is not None and there.certain and there.unstable:
                    return
        if len(errors) == len(self.samples):
            raise errors[0]

    def take(self, places: Iterable[float]) -> list[Sample]:
        """Return the samples at places: more in their order, or those that are there."""
        every = list(places)
        values = {
            place: math.exp(place) if self.logarithmic else place
            for place in every
            if self._at(place) is None
        }
        answers = self.read(list(values.values())) if values else []
        for (place, value), found in zip(values.items(), answers, strict=True):
            self._insert(place, value, found)
        return [there for place in every if (there := self._at(place))]

    def _at(self, place: float) -> Sample | None:
        there = bisect_left(self.samples, place, key=lambda each: each.place)
        found = there < len(self.samples) and self.samples[there].place == place
        return self.samples[there] if found else None

    def _insert(self, place: float, value: float, found: Answer) -> Sample:
        if isinstance(found, TactionError):
            sample = Sample(place, value, np.zeros(0, complex), failure=str(found))
        else:
            sample = Sample(place, value, found.poles, found.errors, found.complete)
        insort(self.samples, sample, key=lambda each: each.place)
        return sample

    def without_crossing(self) -> list[Triple]:
        """Return neighbouring triples with equal numbers of unstable poles."""
        triples = zip(self.samples, self.samples[1:], self.samples[2:], strict=False)
        return [t for t in triples if not any(s.failure for s in t) and _equal(*t)]

    def refine(self, passes: int) -> None:
        """Halve intervals until interpolation proves that poles stay on their side of the axis."""
        for _ in range(passes):
            places = set()
            for a, m, b in self.without_crossing():
                if _bends((a, m, b), _followed(a, m, b).real):
                    places |= {0.5 * (a.place + m.place), 0.5 * (m.place + b.place)}
            if not places:
                return
            self.take(places)

    def climb(self) -> None:
        """Follow every pole that turns back before the axis to its point nearest the axis."""
        for triple in self.without_crossing():
            every = _followed(*triple)
            left, middle, right = np.abs(every.real)
            nearer = every[:, middle < np.minimum(left, right)]
            for each in zip(*nearer.tolist(), strict=True):
                self._climb(triple, each)

    def _climb(self, triple: Triple, pole: Followed) -> None:
        (a, m, b), (pa, pm, pb) = triple, pole
        for _ in range(60):
            near, ends = abs(pm.real), (abs(pa.real), abs(pb.real))
            if not near < min(ends) or _width(a, b) < NARROW:
                return
            top, height = _vertex((a, m, b), (pa.real, pm.real, pb.real))
            if height * np.sign(pm.real) > REACH * near:
                return
            (sample,) = self.take([top])
            if sample.failure or sample.unstable != m.unstable:
                return  # a crossing: `close` brackets it
            found = sample.nearest(_between_places((a, m, b), (pa, pm, pb), top))
            order = sorted([(a, pa), (m, pm), (b, pb), (sample, found)], key=lambda x: x[0].place)
            best = min((1, 2), key=lambda i: abs(order[i][1].real))
            (a, pa), (m, pm), (b, pb) = order[best - 1 : best + 2]

    def changes(self, samples: Sequence[Sample]) -> list[tuple[Sample, Sample]]:
        """Return neighbours with different numbers of unstable poles."""
        pairs = [(a, b) for a, b in pairwise(samples) if not (a.failure or b.failure)]
        differ = [(a, b) for a, b in pairs if a.unstable != b.unstable]
        most = math.inf if self.most is None else self.most
        return [(a, b) for a, b in differ if min(a.unstable, b.unstable) <= most]

    def close(self, tolerance: float) -> None:
        """Bracket every change of the number of unstable poles that is more than rounding."""
        while wide := [
            (a, b)
            for a, b in self.changes(self.samples)
            if _width(a, b) > tolerance and (a.certain or b.certain)
        ]:
            for a, b in wide:
                self._close(a, b, tolerance)

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
            (sample,) = self.take([place])
            if sample.failure:
                return
            a, b = (sample, b) if (sample.real(k) >= 0.0) == (ra >= 0.0) else (a, sample)

    def edges(self) -> list[Edge]:
        """Return the edges between samples off the axis by more than rounding.

        Changes closer than `NARROW` count as one change.
        """
        clusters: list[tuple[Sample, Sample]] = []
        known = [sample for sample in self.samples if sample.certain or sample.failure]
        for a, b in self.changes(known):
            if clusters and _width(clusters[-1][0], b) < NARROW:
                clusters[-1] = (clusters[-1][0], b)
            else:
                clusters.append((a, b))
        return [c for a, b in clusters if a.unstable != b.unstable for c in self._between(a, b)]

    def _between(self, a: Sample, b: Sample) -> list[Edge]:
        """Return the edges between two samples; the change next to the axis is the place."""
        less, more = sorted((a, b), key=lambda each: each.unstable)
        crossed = more.poles[less.unstable : more.unstable]
        frequencies: list[float] = []
        for omega in sorted(np.abs(crossed.imag).tolist()):
            if not frequencies or omega > (1.0 + SAME_FREQUENCY) * frequencies[-1]:
                frequencies.append(omega)
        inside = [sample for sample in self.samples if a.place <= sample.place <= b.place]
        changes = self.changes(inside)
        low, high = changes[0][0], changes[-1][1]
        k = less.unstable
        ra, rb = low.real(k), high.real(k)
        share = ra / (ra - rb) if math.isfinite(ra - rb) and ra * rb < 0.0 else 0.5
        value = low.value + share * (high.value - low.value)
        bound = max(value - a.value, b.value - value)
        return [
            Edge(value, w / (2.0 * math.pi), a.unstable, b.unstable, bound) for w in frequencies
        ]


def _width(a: Sample, b: Sample) -> float:
    return (b.value - a.value) / max(abs(a.value), abs(b.value))


def _equal(*samples: Sample) -> bool:
    return len({sample.unstable for sample in samples}) == 1


def _followed(a: Sample, m: Sample, b: Sample) -> Complexes:
    """Return each pole with Im >= 0 of the sample in the middle, and the nearest ones beside.

    The rows are those of the three samples.
    """
    known = m.poles[: m.known]
    upper = known[known.imag >= 0.0]
    return np.stack([a.nearest_each(upper), upper, b.nearest_each(upper)])


def _bends(triple: Triple, real: Floats) -> bool:
    """Tell whether the real parts, (3, P), of any pole may change sign between the samples."""
    a, m, b = triple
    share = (m.place - a.place) / (b.place - a.place)
    left, middle, right = real
    chord = (1.0 - share) * left + share * right
    nearest = np.abs(real).min(axis=0)
    return bool(np.any(np.abs(middle - chord) > BEND * nearest))


def _between_places(triple: Triple, pole: Followed, place: float) -> complex:
    """Interpolate a pole at a place by the parabola through three samples."""
    total = 0j
    for own, value in zip(triple, pole, strict=True):
        others = [each.place for each in triple if each is not own]
        total += value * math.prod((place - x) / (own.place - x) for x in others)
    return total


def _vertex(triple: Triple, real: tuple[float, float, float]) -> tuple[float, float]:
    """Return place and height of the extreme of the parabola through three points."""
    (a, m, b), (ra, rm, rb) = triple, real
    left, right = m.place - a.place, b.place - m.place
    down, up = (rm - ra) / left, (rb - rm) / right
    curvature = (up - down) / (left + right)
    slope = (down * right + up * left) / (left + right)
    offset = -0.5 * slope / curvature if curvature else 0.0
    height = rm + offset * slope + offset**2 * curvature
    least = 0.05 * (right if offset >= 0.0 else left)
    if abs(offset) < least:  # a new point too near m would not shrink the bracket
        offset = math.copysign(least, offset if offset else right - left)
    return m.place + offset, height
