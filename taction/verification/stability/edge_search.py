"""Every edge of stability of a family: found by loci, confirmed by poles, or found by a scan.

Loci follow from the modes of one board, so poles many decades apart can blind them. Poles of the
boards at the ends of the range, between its edges, and beside each edge, have bounds of their own:
a count that differs from what the edges say is a crossing that the loci missed, and then a scan
finds the edges. The poles of a deck are counted in integers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import pairwise

import numpy as np

from taction.system.array_types import Complexes
from taction.system.errors import TactionError
from taction.verification.engines.statespace.equations.pole_count import (
    characteristic,
    count_right,
)
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
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

PER_DECADE, COUNTED = 20, 40  # values of the first grid of a scan: by poles, and by exact counts
PRECISE = 1e-6  # largest relative bound of a pole of a board whose loci are trusted
BESIDE = (1e-9, 1e-6, 1e-3)  # relative distances of what confirms an edge: the first to do
NEAREST_POLES = 1e-6  # from this distance on poles confirm: rounding hides nearer ones too often
WIDE = 30.0  # largest ratio of neighbouring samples
NONE: Complexes = np.zeros(0, complex)
Count = Callable[[float], int | None]


@dataclass(eq=False)
class EdgeSearch:
    """A search for every edge of a family from `low` to `high` (above zero).

    `found` are the poles at the family's `own` value. With `nearest` the board there, at one of the
    two ends, is stable, and only the edge next to it need be found and confirmed. The edges agree
    with the poles at `values`, too.
    """

    family: Family
    low: float
    high: float
    found: Poles | None = None
    nearest: bool = False
    values: tuple[float, ...] = ()
    edges: Edges = field(init=False)  # what the loci show
    # Tells the number of unstable poles of a deck without its poles.
    count: Count | None = field(default=None, init=False)
    samples: dict[float, Sample] = field(default_factory=dict, init=False)  # by their values

    def traced(self) -> bool:
        """Find what the loci show; False where only a scan is left."""
        ports = self.family.ports
        if ports is None:
            return False
        own = self.found = self.found or poles(ports.board)
        known = own.complete or own.stable  # else the poles are too few to be counted
        count = own.unstable_count if known else count_unstable(ports.board)
        search = LociSearch(ports, *self.family.shares(self.low, self.high), count)
        self.edges = self.family.at_values(search.edges())
        return True

    def certain(self, traced: bool) -> Edges:
        """Return the edges that the loci show, if samples confirm them, else those of samples."""
        return (self.confirmed() if traced else None) or self.scanned()

    @property
    def within(self) -> Range:
        """The range whose edges are to be confirmed."""
        if self.nearest and self.edges.edges:
            upwards = self.family.own == self.low
            at = self.edges.edges[0 if upwards else -1].value
            return (self.low, at) if upwards else (at, self.high)
        return self.low, self.high

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
        own = self.found
        precise = own and own.complete and np.all(own.errors <= PRECISE * np.abs(own.poles))
        for ends in pairwise(sorted({low, *self.inside, high})):
            every.update(_between(*ends, first=1.0 if precise else 0.5))
        beside = 2.0 * BESIDE[0] if self.count else BESIDE[-1]
        return [v for v in every if all(abs(v / at - 1.0) > beside for at in self.inside)]

    def beside(self, distance: float) -> list[float]:
        """Return values on both sides of edges that nearer ones leave open."""
        if self.is_refuted or not (self.count or distance >= NEAREST_POLES):
            return []
        open_ = [at for at in self.inside if math.isinf(self._bound(at))]
        return [at * (1.0 + by) for at in open_ for by in (-distance, distance)]

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
            self._sample(self.beside(distance))
        bounds = {at: self._bound(at) for at in self.inside}
        if self.is_refuted or math.inf in bounds.values():
            return None
        edges = (replace(e, bound=bounds.get(e.value, math.inf)) for e in self.edges.edges)
        beside = {at * (1.0 + d) for at in bounds for by in BESIDE for d in (-by, by)}
        near = {v for v in self.samples if v not in beside and self._agrees(v) is None}
        return replace(self.edges, edges=tuple(edges), near=tuple(sorted(near)))

    def _sample(self, values: Sequence[float]) -> None:
        """Count the unstable poles at values."""
        for value in values:
            if self.count is None:
                found = or_error(lambda at: brief_poles(self.family.board(at)), value)
                self.samples[value] = sampled(value, found)
            else:
                counted = self.count(value)
                on_axis = "" if counted is not None else "a pole is on the imaginary axis"
                self.samples[value] = Sample(value, value, NONE, failure=on_axis, counted=counted)

    def scanned(self) -> Edges:
        """Return the edges by poles at samples alone."""
        density = COUNTED if self.count else PER_DECADE
        points = 2 + math.ceil(density * math.log10(self.high / self.low))
        values = np.geomspace(self.low, self.high, points).tolist()
        values[0], values[-1] = self.low, self.high
        start, count = self.family.own if self.nearest else None, self.count or (lambda value: None)
        return self.family.scan([*values, *self.values], start=start, count=count)


def find_edges(
    family: Family,
    low: float,
    high: float,
    found: Poles | None = None,
    values: Sequence[float] = (),
    *,
    nearest: bool = False,
) -> Edges:
    """Find every edge of a family, or with `nearest` the one next to it; see `EdgeSearch`.

    InputError, EngineError: no board, no equilibrium, no state-space form, or a pole at `own` is on
      the axis.

    Notes
    -----
    Costs the loci, or a scan: the poles of `PER_DECADE` boards per decade, and more.
    """
    (edges,) = edges_together([EdgeSearch(family, low, high, found, nearest, tuple(values))])
    if isinstance(edges, TactionError):
        raise edges
    return edges


def edges_together(searches: Sequence[EdgeSearch]) -> list[Edges | TactionError]:
    """Return the edges of each search, or why there are none."""
    traced = [or_error(EdgeSearch.traced, one) for one in searches]
    _count_decks([one for one, known in zip(searches, traced, strict=True) if known is True])
    return [
        known if isinstance(known, TactionError) else or_error(one.certain, known)
        for one, known in zip(searches, traced, strict=True)
    ]


def _between(low: float, high: float, first: float) -> Iterator[float]:
    """Yield values between two edges, or ends of a range, that are at most `WIDE` apart.

    The `first` step is a half, so that there is at least one value, or a whole one.
    """
    count = math.ceil(math.log(high / low) / math.log(WIDE))
    steps = (k + first for k in range(count) if k + first < count)
    return (low * (high / low) ** (step / count) for step in steps)


def _count_decks(searches: Sequence[EdgeSearch]) -> None:
    """Give the searches over one part of a deck their count of unstable poles."""
    decks = {
        one: one.family.ports.board
        for one in searches
        if one.family.ports and one.family.ports.count == 1 and abs(one.family.power) == 1.0
        if one.family.ports.board.descriptor.has_branches
    }
    doubled = {one: or_error(one.family.board, 2.0 * one.family.own) for one in decks}
    first = {board: characteristic(board.descriptor) for board in dict.fromkeys(decks.values())}
    for one, board in decks.items():
        own, there = first[board], doubled[one]
        second = characteristic(there.descriptor) if isinstance(there, LinearBoard) else None
        if own and second:
            one.count = _exact_count(own, second, one.family.own, int(one.family.power))


def _exact_count(
    first: Sequence[Fraction], doubled: Sequence[Fraction], own: float, power: int
) -> Count:
    """Return the number of unstable poles over a value; None where a pole is on the axis.

    ``det(s M - K)`` is a linear function of the value's `power`; `first` and `doubled` are its
    coefficients at `own`, and at twice its value.
    """
    share = Fraction(2) ** power
    change = [(b - a) / (share - 1) for a, b in zip(first, doubled, strict=True)]

    def count(value: float) -> int | None:
        more = (Fraction(value) / Fraction(own)) ** power - 1
        return count_right([a + more * b for a, b in zip(first, change, strict=True)])

    return count
