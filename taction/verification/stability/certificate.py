"""Poles beside the edges that loci show certify them, and so do poles between them.

Loci follow from the modes of one board, so poles many decades apart can blind them. Poles of the
boards at the ends of the range, between its edges, and beside each edge, have bounds of their own:
a count that differs from what the edges say is a crossing that the loci missed. The poles of a
deck are counted in integers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import pairwise

import numpy as np

from taction.system.array_types import Complexes
from taction.verification.engines.statespace.equations.pole_count import count_right
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edges, Range, Sample
from taction.verification.stability.poles import or_error, poles_together
from taction.verification.stability.scan import sampled

BESIDE = (1e-9, 1e-6, 1e-3)  # relative distances of what confirms an edge: the first to do
NEAREST_POLES = 1e-6  # from this distance on poles confirm: rounding hides nearer ones too often
WIDE = 30.0  # largest ratio of neighbouring samples
NONE: Complexes = np.zeros(0, complex)
Count = Callable[[float], int | None]


def exact_count(
    first: Sequence[Fraction], doubled: Sequence[Fraction], own: float, power: float
) -> Count:
    """Return the number of unstable poles over a value; None where a pole is on the axis.

    ``det(s M - K)`` is a linear function of the value's `power`; `first` and `doubled` are its
    coefficients at `own`, and at twice its value.
    """
    share = Fraction(2) ** int(power)
    change = [(b - a) / (share - 1) for a, b in zip(first, doubled, strict=True)]

    def count(value: float) -> int | None:
        more = (Fraction(value) / Fraction(own)) ** int(power) - 1
        return count_right([a + more * b for a, b in zip(first, change, strict=True)])

    return count


@dataclass(frozen=True, slots=True, eq=False)
class EdgeClaim:
    """Edges over a value above zero, and the samples that confirm or refute them."""

    edges: Edges  # what the loci show
    board: Callable[[float], LinearBoard]  # the board at a value
    within: Range  # range whose edges are to be confirmed
    known: float  # a value whose poles are known
    values: tuple[float, ...] = ()  # values in it that count besides
    count: Count | None = None  # tells the number of unstable poles of a deck without its poles
    # Whether every pole is known well: then near edges and ends need no samples between them.
    precise: bool = False
    samples: dict[float, Sample] = field(default_factory=dict)  # by their values

    @property
    def inside(self) -> list[float]:
        """The edges in the range."""
        low, high = self.within
        return [edge.value for edge in self.edges.edges if low <= edge.value <= high]

    @property
    def apart(self) -> list[float]:
        """Values in the range that are not as near to an edge as the poles that confirm it."""
        low, high = self.within
        near = (at for at in self.edges.near if low <= at <= high)
        every = {low, high, *self.values, *near} - {self.known}
        for ends in pairwise(sorted({low, *self.inside, high})):
            every.update(_between(*ends, first=1.0 if self.precise else 0.5))
        beside = 2.0 * BESIDE[0] if self.count else BESIDE[-1]
        return [v for v in every if all(abs(v / at - 1.0) > beside for at in self.inside)]

    def beside(self, distance: float) -> list[float]:
        """Return values on both sides of edges that nearer ones leave open."""
        if self.is_refuted or not (self.count or distance >= NEAREST_POLES):
            return []
        open_ = [at for at in self.inside if math.isinf(self.bound(at))]
        return [at * (1.0 + by) for at in open_ for by in (-distance, distance)]

    def _agrees(self, value: float) -> bool | None:
        sample = self.samples.get(value)
        return None if sample is None else sample.agrees(self.edges.unstable_at(value))

    @property
    def is_refuted(self) -> bool:
        """Whether a sample has another number of unstable poles than the edges say."""
        return any(self._agrees(value) is False for value in self.samples)

    def bound(self, at: float) -> float:
        """Return how near samples on both sides of an edge confirm it; infinite without."""
        both = (by for by in BESIDE if all(self._agrees(at * (1.0 + d)) for d in (-by, by)))
        return next(both, math.inf) * at

    @property
    def confirmed(self) -> Edges | None:
        """The edges with their bounds, or None where samples do not confirm them.

        A sample of which rounding hides the side of a pole is a near value.
        """
        bounds = {at: self.bound(at) for at in self.inside}
        if self.is_refuted or math.inf in bounds.values():
            return None
        edges = (replace(e, bound=bounds.get(e.value, math.inf)) for e in self.edges.edges)
        beside = {at * (1.0 + d) for at in bounds for by in BESIDE for d in (-by, by)}
        near = {v for v in self.samples if v not in beside and self._agrees(v) is None}
        return replace(self.edges, edges=tuple(edges), near=tuple(sorted(near)))


def _between(low: float, high: float, first: float) -> Iterator[float]:
    """Yield values between two edges, or ends of a range, that are at most `WIDE` apart.

    The `first` step is a half, so that there is at least one value, or a whole one.
    """
    count = math.ceil(math.log(high / low) / math.log(WIDE))
    steps = (k + first for k in range(count) if k + first < count)
    return (low * (high / low) ** (step / count) for step in steps)


def certify(claims: Sequence[EdgeClaim]) -> list[Edges | None]:
    """Return the edges of each claim with their bounds, or None where poles do not confirm them.

    The poles of all claims are found together.
    """
    _sample([(claim, value) for claim in claims for value in claim.apart])
    for distance in BESIDE:
        _sample([(claim, value) for claim in claims for value in claim.beside(distance)])
    return [claim.confirmed for claim in claims]


def _sample(asked: Sequence[tuple[EdgeClaim, float]]) -> None:
    """Count the unstable poles of claims at values."""
    boards = (or_error(claim.board, value) for claim, value in asked if claim.count is None)
    poles = iter(poles_together(boards))
    for claim, value in asked:
        if claim.count is None:
            claim.samples[value] = sampled(value, next(poles))
        else:
            counted = claim.count(value)
            on_axis = "" if counted is not None else "a pole is on the imaginary axis"
            claim.samples[value] = Sample(value, value, NONE, failure=on_axis, counted=counted)
