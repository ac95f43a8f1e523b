"""Every edge of stability of a family: found by loci, confirmed by poles, or found by a scan.

Loci follow from the modes of one board, so poles many decades apart can blind them. Poles of the
boards at the ends of the range, between its edges, and beside each edge, have bounds of their own:
a count that differs from what the edges say is a crossing that the loci missed, and then a scan
finds the edges.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from taction.verification.stability.edges import Edges, Range, Sample
from taction.verification.stability.families import Family
from taction.verification.stability.loci import LociSearch
from taction.verification.stability.poles import (
    Poles,
    brief_poles,
    count_unstable,
    or_error,
    poles,
)
from taction.verification.stability.scan import sampled

PER_DECADE = 20  # values of the first grid of a scan
PRECISE = 1e-6  # largest relative bound of a pole of a board whose loci are trusted
BESIDE = (1e-6, 1e-3)  # relative distances of what confirms an edge: the first to do
WIDE = 30.0  # largest ratio of neighbouring samples


def find_edges(
    family: Family,
    low: float,
    high: float,
    found: Poles | None = None,
    values: Sequence[float] = (),
    *,
    nearest: bool = False,
) -> Edges:
    """Find every edge of a family from `low` to `high` (above zero).

    `found`: poles at the family's `own` value, if they have been computed before.
    `values`: the edges agree with the poles at these, too.
    `nearest`: the board at `own`, one of the two ends, is stable, and only the edge next to it need
      be found and confirmed.
    InputError, EngineError: no board, no equilibrium, no state-space form, or a pole at `own` is on
      the axis.

    Notes
    -----
    Costs the loci, or a scan: the poles of `PER_DECADE` boards per decade, and more.
    """
    if (ports := family.ports) is not None:
        own = found or poles(ports.board)
        known = own.complete or own.stable  # else the poles are too few to be counted
        count = own.unstable_count if known else count_unstable(ports.board)
        traced = LociSearch(ports, *family.shares(low, high), count).edges()
        search = _Confirmation(family, own, family.at_values(traced), nearest, tuple(values))
        if (edges := search.confirmed()) is not None:
            return edges
    points = 2 + math.ceil(PER_DECADE * math.log10(high / low))
    grid = [low, *np.geomspace(low, high, points)[1:-1].tolist(), high]
    return family.scan([*grid, *values], start=family.own if nearest else None)


@dataclass(eq=False)
class _Confirmation:
    """What the loci of a family show, and the samples that confirm it; see `find_edges`."""

    family: Family
    own: Poles  # at the family's own value
    edges: Edges
    nearest: bool
    values: tuple[float, ...]
    samples: dict[float, Sample] = field(default_factory=dict)  # by their values

    @property
    def within(self) -> Range:
        """The range whose edges are to be confirmed."""
        low, high = self.edges.low, self.edges.high
        if self.nearest and self.edges.edges:
            upwards = self.family.own == low
            at = self.edges.edges[0 if upwards else -1].value
            return (low, at) if upwards else (at, high)
        return low, high

    @property
    def inside(self) -> list[float]:
        """The edges in the range."""
        low, high = self.within
        return [edge.value for edge in self.edges.edges if low <= edge.value <= high]

    def apart(self) -> list[float]:
        """Return values in the range that are not as near to an edge as what confirms it.

        Where every pole is known well, near edges and ends need no samples between them.
        """
        low, high = self.within
        near = (at for at in self.edges.near if low <= at <= high)
        every = {low, high, *self.values, *near} - {self.family.own}
        precise = self.own.complete and np.all(self.own.errors <= PRECISE * np.abs(self.own.poles))
        for ends in pairwise(sorted({low, *self.inside, high})):
            every.update(_between(*ends, first=1.0 if precise else 0.5))
        return [v for v in every if all(abs(v / at - 1.0) > BESIDE[-1] for at in self.inside)]

    def _agrees(self, value: float) -> bool | None:
        sample = self.samples.get(value)
        return None if sample is None else sample.agrees(self.edges.unstable_at(value))

    @property
    def is_refuted(self) -> bool:
        """Whether a sample has another number of unstable poles than the edges say."""
        return any(self._agrees(value) is False for value in self.samples)

    def _bound(self, at: float) -> float:
        """Return how near samples on both sides of an edge confirm it; infinite without."""
        both = (by for by in BESIDE if all(self._agrees(at * (1.0 + d)) for d in (-by, by)))
        return next(both, math.inf) * at

    def confirmed(self) -> Edges | None:
        """Return the edges with their bounds, or None where samples do not confirm them.

        A sample of which rounding hides the side of a pole is a near value. Edges of a large board,
        whose poles cost seconds, are not confirmed unless only the nearest one is wanted.
        """
        ports = self.family.ports
        if ports is not None and ports.board.descriptor.is_large and not self.nearest:
            return self.edges
        self._sample(self.apart())
        for distance in BESIDE:
            open_ = [at for at in self.inside if math.isinf(self._bound(at))]
            if not self.is_refuted:
                self._sample(at * (1.0 + by) for at in open_ for by in (-distance, distance))
        bounds = {at: self._bound(at) for at in self.inside}
        if self.is_refuted or math.inf in bounds.values():
            return None
        edges = (replace(e, bound=bounds.get(e.value, math.inf)) for e in self.edges.edges)
        beside = {at * (1.0 + d) for at in bounds for by in BESIDE for d in (-by, by)}
        near = {v for v in self.samples if v not in beside and self._agrees(v) is None}
        return replace(self.edges, edges=tuple(edges), near=tuple(sorted(near)))

    def _sample(self, values: Iterable[float]) -> None:
        """Find the poles at values."""
        for value in values:
            found = or_error(lambda at: brief_poles(self.family.board(at)), value)
            self.samples[value] = sampled(value, found)


def _between(low: float, high: float, first: float) -> Iterator[float]:
    """Yield values between two edges, or ends of a range, that are at most `WIDE` apart.

    The `first` step is a half, so that there is at least one value, or a whole one.
    """
    count = math.ceil(math.log(high / low) / math.log(WIDE))
    steps = (k + first for k in range(count) if k + first < count)
    return (low * (high / low) ** (step / count) for step in steps)
