"""Edges of stability: the values of a knob at which a pole is on the imaginary axis.

`loci` and `scan` find them; margins, stable ranges, onset and boundary read them. A knob is
anything that moves a board by one number: its C, its gain, a key of its scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np

from taction.system.array_types import Complexes, Floats

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

    @classmethod
    def counted(
        cls,
        ends: Range,
        changes: Iterable[tuple[float, float, int]],
        near: Iterable[float],
        known: tuple[float, int],
        off: float,
    ) -> Edges:
        """Return the edges of `changes`: values, frequencies, changes of the unstable count.

        A change is that of the count as the value grows; `known` is a value with its count, and
        `off` the largest relative error of the values.
        """
        ordered = sorted(changes)
        lowest = count = known[1] - sum(by for value, _, by in ordered if value < known[0])
        edges = []
        for value, frequency, by in ordered:
            edges.append(Edge(value, frequency, count, count + by, off * value))
            count += by
        return cls(*ends, tuple(edges), tuple(near), lowest)

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
    """Poles at one value."""

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
                before = self.samples[first - 1] if first > 0 else None
                after = self.samples[last + 1] if last + 1 < len(self.samples) else None
                low = self._end(self.samples[first], before)
                ranges.append((low, self._end(self.samples[last], after)))
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

    def _end(self, inside: Sample, outside: Sample | None) -> float:
        """Return the end of a range: the edge between two neighbouring samples, if there is one."""
        if outside is None:
            return inside.value
        low, high = sorted((inside.value, outside.value))
        return next((e.value for e in self.edges if low <= e.value <= high), inside.value)
