"""Edges of stability: the values of a knob at which a pole is on the imaginary axis.

`loci` and `scan` find them; margins, stable ranges, onset and boundary read them. A knob is
anything that moves a board by one number: its C, its gain, a key of its scene.

A scan samples all poles on a grid, follows each to the samples beside it, and halves steps until
interpolation shows that no pole changes the side of the axis between samples without being counted:
so a crossing and its reverse are found, too, if they are more than `FINEST` apart. Then it brackets
each change of the number of unstable poles: the k-th largest real part is a continuous function of
the value, and a crossing is a zero of one of these.
"""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, pairwise

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.system.errors import TactionError
from taction.verification.stability.poles import Poles

TOLERANCE = 1e-8  # of a crossing's value
FINEST = 1e-3  # relative width of the narrowest step in which a crossing and its reverse are sought
BEND = 0.5  # of the distance to the axis: largest error of interpolation without more points
ROUNDS = 2  # of halving and bracketing: an edge may hide others in its step
NARROW = 1e-6  # relative width below which rounding can decide the side of the axis
BESIDE_CHORD = 0.02  # of a bracket's width: samples beside its zero by interpolation
SAME_FREQUENCY = 1e-3  # relative difference of frequencies that count as equal

Read = Callable[[float], Poles]  # returns the poles at a value, or raises a `TactionError`
Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Edge:
    """A value of a knob with a pole, or a complex pair, on the imaginary axis."""

    value: float  # of the knob, in its unit
    frequency: float  # Hz; 0 for a real pole
    # `below`, `above`: number of unstable poles below and above the value; at most 1 where not all
    # poles are known.
    below: int
    above: int
    # Bound on the error of `value`, in its unit: by the poles on both sides; where these are not
    # known, of the interpolation between points of a locus; infinite where neither is known.
    bound: float = math.inf

    @property
    def unstable_above(self) -> bool:
        """Whether the pole is unstable above `value` (else below)."""
        return self.above > self.below

    @property
    def pole(self) -> complex:
        """The pole on the axis, 1/s."""
        return complex(0.0, 2.0 * math.pi * self.frequency)

    @property
    def changes_stability(self) -> bool:
        """Whether the board is stable on one side."""
        return min(self.below, self.above) == 0


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Every edge between two values of a knob."""

    # `low`, `high`: ends of the search.
    low: float
    high: float
    edges: tuple[Edge, ...]  # in increasing order of the value
    # Values at which rounding, or a missing result, hides on which side of the axis a pole is.
    near: tuple[float, ...] = ()
    lowest: int = 0  # number of unstable poles at `low`

    def unstable_at(self, value: float) -> int:
        """Count the unstable poles at a value between two edges."""
        return next((e.below for e in self.edges if value <= e.value), self._last)

    @property
    def _last(self) -> int:
        return self.edges[-1].above if self.edges else self.lowest

    @property
    def stable_ranges(self) -> tuple[Range, ...]:
        """Parts of the searched range in which every pole is left of the axis."""
        ends = [self.low, *(edge.value for edge in self.edges), self.high]
        counts = [*(edge.below for edge in self.edges), self._last]
        ranges: list[Range] = []
        for low, high, unstable in zip(ends, ends[1:], counts, strict=False):
            if unstable:
                continue
            if ranges and ranges[-1][1] == low:  # the poles that cross there cancel each other
                ranges[-1] = (ranges[-1][0], high)
            elif low < high:
                ranges.append((low, high))
        return tuple(ranges)


@dataclass(frozen=True, eq=False)
class Sample:
    """Poles at one value; its document says why there are none."""

    DOCUMENT = ("value", "reason = failure")

    place: float  # on the axis of interpolation: the value, or its logarithm
    value: float
    poles: Complexes  # 1/s, rightmost first
    errors: Floats | float = 0.0  # rounding errors of the poles' real parts, 1/s
    complete: bool = True  # whether `poles` holds all poles; of an incomplete set the first counts
    failure: str = ""  # why there are no poles

    @property
    def known(self) -> int:
        """Number of leading poles that are certainly the rightmost poles."""
        return len(self.poles) if self.complete else min(len(self.poles), 1)

    @cached_property
    def unstable(self) -> int:
        """Number of poles on or right of the imaginary axis; at most 1 of an incomplete set."""
        return int(np.sum(self.poles.real[: self.known] >= 0.0))

    @property
    def stable(self) -> bool:
        """Whether all poles are left of the imaginary axis."""
        return not self.failure and self.unstable == 0

    @cached_property
    def certain(self) -> bool:
        """Whether all known poles are off the imaginary axis by more than rounding."""
        off = np.abs(self.poles.real) > self.errors
        return not self.failure and bool(np.all(off[: self.known]))

    def agrees(self, unstable: int) -> bool | None:
        """Tell whether so many poles are unstable; None where rounding hides it."""
        if self.certain:
            return self.unstable == (unstable if self.complete else min(unstable, 1))
        real = self.poles.real
        least, most = int(np.sum(real > self.errors)), int(np.sum(real >= -self.errors))
        open_ = bool(self.failure) or not self.complete or least <= unstable <= most
        return None if open_ else False

    def nearest_each(self, places: Complexes) -> Complexes:
        """Return the known pole nearest to each place (P,) in the complex plane, 1/s."""
        known = self.poles[: self.known]
        if not len(known):
            return np.full(len(places), complex(-math.inf))
        return np.asarray(known[np.abs(known - places[:, None]).argmin(axis=1)])

    def real(self, k: int) -> float:
        """Return the k-th largest real part (k from 0), 1/s; minus infinity beyond the last."""
        return float(self.poles.real[k]) if k < self.known else -math.inf


@dataclass(frozen=True, slots=True, eq=False)
class Scan(Edges):
    """Edges between samples, which are in increasing order of the value."""

    samples: tuple[Sample, ...] = ()
    logarithmic: bool = True
    traced: Edges | None = None  # edges that the loci of one board show, if any were traced

    @property
    def counts(self) -> tuple[tuple[float, int, int], ...]:
        """Values between edges with their unstable poles: at samples, and as the loci count them.

        Empty where not all poles are known, without loci, and where these come near the axis.
        """
        if self.traced is None or self.traced.near or not self.complete:
            return ()
        ends = [self.low, *(edge.value for edge in self.edges), self.high]
        middles = (math.sqrt(a * b) for a, b in pairwise(ends) if a < b)
        return tuple((at, self.unstable_at(at), self.traced.unstable_at(at)) for at in middles)

    @property
    def points(self) -> int:
        """Number of samples."""
        return len(self.samples)

    @property
    def scale(self) -> str:
        """Their spacing."""
        return "logarithmic" if self.logarithmic else "linear"

    @property
    def complete(self) -> bool:
        """Whether all poles are known, else only edges of the rightmost pole are listed."""
        return all(sample.complete for sample in self.samples)

    @property
    def stable_ranges(self) -> tuple[Range, ...]:
        """Parts of the scanned range in which every pole is left of the axis.

        A part without a sample whose poles are left of the axis by more than rounding is none.
        """
        ranges = []
        for stable, inside in self._parts(lambda sample: sample.stable):
            if stable and any(self.samples[n].certain for n in inside):
                first, last = inside[0], inside[-1]
                ranges.append((self._end(first, first - 1), self._end(last, last + 1)))
        return tuple(ranges)

    @property
    def unresolved(self) -> tuple[Range, ...]:
        """Parts in which rounding decides the side of a pole, except those at an edge."""
        ranges = []
        for certain, inside in self._parts(lambda sample: sample.certain or bool(sample.failure)):
            beside = self.samples[max(inside[0] - 1, 0) : inside[-1] + 2]
            counts = {sample.unstable for sample in beside if sample.certain}
            if not certain and len(counts) < 2:
                ranges.append((self.samples[inside[0]].value, self.samples[inside[-1]].value))
        return tuple(ranges)

    def _parts(self, key: Callable[[Sample], bool]) -> Iterator[tuple[bool, list[int]]]:
        """Yield runs of neighbouring samples with the same key."""
        indices = range(len(self.samples))
        for value, group in groupby(indices, key=lambda n: key(self.samples[n])):
            yield value, list(group)

    def _end(self, inside: int, outside: int) -> float:
        """Return the end of a range: the edge between two neighbouring samples, if there is one."""
        value = self.samples[inside].value
        if not 0 <= outside < len(self.samples):
            return value
        low, high = sorted((value, self.samples[outside].value))
        return next((e.value for e in self.edges if low <= e.value <= high), value)


def scan(
    values: Sequence[float], read: Read, *, logarithmic: bool = True, start: float | None = None
) -> Scan:
    """Find every edge between the least and the largest of `values`.

    Of incomplete poles, as those of a large board, only crossings of the rightmost one are listed.

    `logarithmic`: whether to interpolate and halve in the logarithm of the value, which is above 0.
    `start`: the least or the largest of `values`, of a stable board, if only the edge next to it is
      wanted: the scan goes no further than the first value of a board that is certainly unstable.
    InputError, EngineError: no value gives poles. If only some values fail, see `Sample.failure`.
    """
    search = _Search(read, logarithmic)
    search.begin(values, start)
    for _ in range(ROUNDS):
        search.refine()
        search.close()
    samples = tuple(search.samples)
    failed = tuple(sample.value for sample in samples if sample.failure)
    ends, lowest = (samples[0].value, samples[-1].value), samples[0].unstable
    found = Scan(*ends, tuple(search.edges()), failed, lowest, samples, logarithmic)
    hidden = {value for ends in found.unresolved for value in ends}
    return replace(found, near=tuple(sorted({*failed, *hidden})))


@dataclass(slots=True)
class _Search:
    """A scan in progress: samples in increasing order of the value."""

    read: Read
    logarithmic: bool
    samples: list[Sample] = field(default_factory=list)

    def begin(self, values: Sequence[float], start: float | None) -> None:
        """Take the samples of the first grid; raise an error if none of them has poles."""
        for value in sorted({float(value) for value in values}, reverse=start == max(values)):
            self._insert(math.log(value) if self.logarithmic else value, value)
            if start and any(each.certain and each.unstable for each in self.samples):
                break
        if all(sample.failure for sample in self.samples):
            self.read(self.samples[0].value)  # it raises the error

    def take(self, places: Iterable[float]) -> bool:
        """Take samples at places; return whether there are new ones."""
        new = {*places} - {sample.place for sample in self.samples}
        for place in sorted(new):
            self._insert(place, math.exp(place) if self.logarithmic else place)
        return bool(new)

    def _insert(self, place: float, value: float) -> None:
        """Insert the sample at a value."""
        insort(self.samples, sampled(self.read, value, place), key=lambda each: each.place)

    def refine(self) -> None:
        """Halve steps until interpolation shows that poles stay on their side of the axis."""
        found = True
        while found:
            places = set[float]()
            for a, m, b in zip(self.samples, self.samples[1:], self.samples[2:], strict=False):
                if len({a.unstable, m.unstable, b.unstable}) == 1 and _bends((a, m, b)):
                    steps = [each for each in ((a, m), (m, b)) if _width(*each) > FINEST]
                    places |= {0.5 * (left.place + right.place) for left, right in steps}
            found = self.take(places)

    def changes(self, samples: Sequence[Sample]) -> list[tuple[Sample, Sample]]:
        """Return neighbours with different numbers of unstable poles."""
        return [
            (a, b)
            for a, b in pairwise(samples)
            if not (a.failure or b.failure) and a.unstable != b.unstable
        ]

    def close(self) -> None:
        """Bracket every change of the number of unstable poles that is more than rounding."""
        wide = True
        while wide:
            wide = self.take(
                place
                for a, b in self.changes(self.samples)
                if _width(a, b) > TOLERANCE and (a.certain or b.certain)
                for place in _inside(a, b)
            )

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
        value = low.value + _zero(low, high) * (high.value - low.value)
        bound = max(value - a.value, b.value - value)
        return [Edge(value, w / math.tau, a.unstable, b.unstable, bound) for w in frequencies]


def sampled(read: Read, value: float, place: float = math.nan) -> Sample:
    """Return the sample of the poles at a value, or of why there are none."""
    try:
        found = read(value)
    except TactionError as error:
        return Sample(place, value, np.zeros(0, complex), failure=str(error))
    return Sample(place, value, found.poles, found.errors, found.complete)


def _width(a: Sample, b: Sample) -> float:
    return (b.value - a.value) / max(abs(a.value), abs(b.value))


def _zero(a: Sample, b: Sample) -> float:
    """Return where between two samples the pole that changes its side is on the axis: 0 to 1."""
    k = min(a.unstable, b.unstable)
    ra, rb = a.real(k), b.real(k)
    opposite = math.isfinite(ra - rb) and ra * rb <= 0.0 and ra != rb
    return ra / (ra - rb) if opposite else 0.5


def _inside(a: Sample, b: Sample) -> list[float]:
    """Return places in a bracket: beside the zero by interpolation, and the middle."""
    middle = 0.5 * (a.place + b.place)
    if not a.place < middle < b.place:
        return []
    width, zero = b.place - a.place, _zero(a, b)
    beside = (a.place + (zero + by) * width for by in (-BESIDE_CHORD, BESIDE_CHORD))
    return [middle, *(place for place in beside if a.place < place < b.place)]


def _bends(triple: tuple[Sample, Sample, Sample]) -> bool:
    """Tell whether the real part of any pole may change its sign between the samples."""
    a, m, b = triple
    if any(sample.failure for sample in triple):
        return False
    known = m.poles[: m.known]
    upper = known[known.imag >= 0.0]
    left, middle, right = (a.nearest_each(upper).real, upper.real, b.nearest_each(upper).real)
    share = (m.place - a.place) / (b.place - a.place)
    off = np.abs(middle - (1.0 - share) * left - share * right)
    nearest = np.minimum(np.minimum(np.abs(left), np.abs(middle)), np.abs(right))
    return bool(np.any(off > BEND * nearest))
