"""Results of a scan of poles over one value: samples, crossings, stable ranges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from spice_models.array_types import Complexes


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Poles at one value."""

    place: float  # on the axis of interpolation: the value, or its logarithm
    value: float
    poles: Complexes  # 1/s, rightmost first
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
        """Parts of the scanned range in which every pole is left of the axis."""
        ranges, end = [], len(self.samples)
        for stable, group in groupby(range(end), key=lambda n: self.samples[n].stable):
            if stable:
                inside = list(group)
                first, last = inside[0], inside[-1]
                before = self.samples[first - 1] if first > 0 else None
                after = self.samples[last + 1] if last + 1 < end else None
                low = self._edge(self.samples[first], before)
                ranges.append((low, self._edge(self.samples[last], after)))
        return tuple(ranges)

    def _edge(self, inside: Sample, outside: Sample | None) -> float:
        if outside is None:
            return inside.value
        low, high = sorted((inside.value, outside.value))
        return next((c.value for c in self.crossings if low <= c.value <= high), inside.value)
