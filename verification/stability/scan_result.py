"""Results of a scan of poles over one value: samples, crossings, stable ranges."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from taction.system.array_types import Complexes, Floats


@dataclass(frozen=True, slots=True, eq=False)
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

    @property
    def unstable(self) -> int:
        """Number of poles on or right of the imaginary axis; at most 1 of an incomplete set."""
        return int(np.sum(self.poles.real[: self.known] >= 0.0))

    @property
    def stable(self) -> bool:
        """Whether all poles are left of the imaginary axis."""
        return not self.failure and self.unstable == 0

    @property
    def certain(self) -> bool:
        """Whether all known poles are off the imaginary axis by more than rounding."""
        off = np.abs(self.poles.real) > self.errors
        return not self.failure and bool(np.all(off[: self.known]))

    def nearest(self, place: complex) -> complex:
        """Return the known pole nearest to a place in the complex plane, 1/s."""
        known = self.poles[: self.known]
        return (
            complex(known[np.argmin(np.abs(known - place))]) if len(known) else complex(-math.inf)
        )

    def real(self, k: int) -> float:
        """Return the k-th largest real part (k from 0), 1/s; minus infinity beyond the last."""
        return float(self.poles.real[k]) if k < self.known else -math.inf


@dataclass(frozen=True, slots=True)
class AxisCrossing:
    """A pole, or a complex pair, on the imaginary axis."""

    value: float
    frequency: float  # Hz; 0 for a real pole
    unstable_above: bool  # whether the pole is unstable above `value` (else below)
    below: int  # number of unstable poles below `value`; at most 1 if the scan is not complete
    above: int  # the same above `value`

    @property
    def pole(self) -> complex:
        """The pole on the axis, 1/s."""
        return complex(0.0, 2.0 * math.pi * self.frequency)

    @property
    def changes_stability(self) -> bool:
        """Whether the board is stable on one side."""
        return min(self.below, self.above) == 0


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Samples in increasing order of the value, and the crossings among them."""

    samples: tuple[Sample, ...]
    crossings: tuple[AxisCrossing, ...]
    logarithmic: bool

    @property
    def complete(self) -> bool:
        """Whether all poles are known, else only crossings of the rightmost pole are listed."""
        return all(sample.complete for sample in self.samples)

    @property
    def stable_ranges(self) -> tuple[tuple[float, float], ...]:
        """Parts of the scanned range in which every pole is left of the axis.

        A part without a sample whose poles are left of the axis by more than rounding is none.
        """
        ranges = []
        for stable, inside in self._parts(lambda sample: sample.stable):
            if stable and any(self.samples[n].certain for n in inside):
                first, last = inside[0], inside[-1]
                before = self.samples[first - 1] if first > 0 else None
                after = self.samples[last + 1] if last + 1 < len(self.samples) else None
                low = self._edge(self.samples[first], before)
                ranges.append((low, self._edge(self.samples[last], after)))
        return tuple(ranges)

    @property
    def unresolved(self) -> tuple[tuple[float, float], ...]:
        """Parts in which rounding decides the side of a pole, except those at a crossing."""
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

    def _edge(self, inside: Sample, outside: Sample | None) -> float:
        if outside is None:
            return inside.value
        low, high = sorted((inside.value, outside.value))
        return next((c.value for c in self.crossings if low <= c.value <= high), inside.value)
