"""What a scan of poles over one value yields: samples, crossings, stable ranges."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Complexes


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Poles at one value.

    Attributes
    ----------
    place : float
        Where it stands: the value, or its logarithm.
    value : float
        The value itself.
    poles : ndarray
        1/s, rightmost first.
    complete : bool
        Whether they are all poles; of a large board only the first one counts.
    failure : str
        Why there are none; empty where there are.
    """

    place: float
    value: float
    poles: Complexes
    complete: bool = True
    failure: str = ""

    @property
    def known(self) -> int:
        """How many poles from the right are known to be the first ones."""
        return len(self.poles) if self.complete else min(len(self.poles), 1)

    @property
    def unstable(self) -> int:
        """Number of poles on or right of the imaginary axis; 1 for any of an incomplete set."""
        return int(np.sum(self.poles.real[: self.known] >= 0.0))

    @property
    def stable(self) -> bool:
        """Whether it has poles, all left of the imaginary axis."""
        return not self.failure and self.unstable == 0

    def real(self, k: int) -> float:
        """Real part of the k-th pole from the right (from 0), 1/s; minus infinity beyond all."""
        return float(self.poles.real[k]) if k < self.known else -math.inf


@dataclass(frozen=True, slots=True)
class AxisCrossing:
    """One pole, or a complex pair, on the imaginary axis.

    Attributes
    ----------
    value : float
        Where.
    frequency : float
        Hz; 0 for a real pole.
    unstable_above : bool
        Whether it is in the right half plane above `value` (else below).
    below, above : int
        Number of unstable poles on either side; 1 for any where the scan is not `complete`.
    """

    value: float
    frequency: float
    unstable_above: bool
    below: int
    above: int

    @property
    def pole(self) -> complex:
        """The pole on the axis, 1/s."""
        return complex(0.0, 2.0 * math.pi * self.frequency)

    @property
    def changes_stability(self) -> bool:
        """Whether the board is stable on one of its sides."""
        return min(self.below, self.above) == 0


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Samples in increasing order of the value, and the crossings among them."""

    samples: tuple[Sample, ...]
    crossings: tuple[AxisCrossing, ...]
    logarithmic: bool

    @property
    def complete(self) -> bool:
        """Whether all poles were seen, else only crossings of the rightmost one are listed."""
        return all(sample.complete for sample in self.samples)

    @property
    def stable_ranges(self) -> tuple[tuple[float, float], ...]:
        """Stretches of the scanned range on which every pole is left of the axis."""
        found = []
        start: float | None = None
        for before, here, after in zip(
            (None, *self.samples), self.samples, (*self.samples[1:], None), strict=False
        ):
            if not here.stable:
                continue
            if before is None or not before.stable:
                start = self._edge(here, before)
            if start is not None and (after is None or not after.stable):
                found.append((start, self._edge(here, after)))
        return tuple(found)

    def _edge(self, inside: Sample, outside: Sample | None) -> float:
        if outside is None:
            return inside.value
        low, high = sorted((inside.value, outside.value))
        return next((c.value for c in self.crossings if low <= c.value <= high), inside.value)
