"""Poles at samples of a range certify the edges that loci show there.

Loci follow from the modes of one board, so poles many decades apart can blind them. Poles of the
boards at the ends of the range, between its edges, and beside each edge, have bounds of their own:
a count that differs from what the edges say is a crossing that the loci missed. The poles of a
deck are counted in integers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, pairwise

from taction.system.errors import TactionError
from taction.verification.engines.statespace.equations.exact_count import (
    characteristic,
    count_right,
)
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.edges import Edge, Edges
from taction.verification.stability.poles import Poles, or_error, poles_together

BESIDE = (1e-9, 1e-6, 1e-3)  # relative distances of what confirms an edge: the first to do
NEAREST_POLES = 1e-6  # from this distance on poles confirm: rounding hides nearer ones too often
WIDE = 30.0  # largest ratio of neighbouring samples
GRID = 40  # values per decade of a search by counts alone
Count = tuple[float, float]  # least and largest number
UNKNOWN: Count = (0, math.inf)


@dataclass(frozen=True, slots=True, eq=False)
class ExactCount:
    """Number of unstable poles over a value, of which ``det(s M - K)`` is a linear function.

    The polynomial at a value is ``first + (share - 1) change``, with the share of the value's
    `power` in that of `own`.
    """

    first: Sequence[Fraction]
    change: Sequence[Fraction]
    own: float
    power: int

    @classmethod
    def of(
        cls, first: Sequence[Fraction] | None, doubled: LinearBoard, own: float, power: float
    ) -> ExactCount | None:
        """Return the count from the polynomials at `own` and at twice its value, if it has one."""
        second = characteristic(doubled.descriptor)
        if first is None or second is None or abs(power) != 1.0:
            return None
        share = Fraction(2) ** int(power)
        change = [(b - a) / (share - 1) for a, b in zip(first, second, strict=True)]
        return cls(first, change, own, int(power))

    def __call__(self, value: float) -> int | None:
        """Return the number at a value; None where a pole is on the axis."""
        more = (Fraction(value) / Fraction(self.own)) ** self.power - 1
        return count_right([a + more * b for a, b in zip(self.first, self.change, strict=True)])


@dataclass(frozen=True, slots=True, eq=False)
class EdgeClaim:
    """Edges over a value above zero, the board at a value, and values that count besides.

    `count` tells the number of unstable poles of a deck without its poles. The loci of a `precise`
    board, of which every pole is known well, need no samples between the ends and the edges.
    """

    edges: Edges
    board: Callable[[float], LinearBoard]
    values: tuple[float, ...] = ()
    count: ExactCount | None = None
    precise: bool = False

    @property
    def samples(self) -> list[float]:
        """Values at the ends, between the edges, and those that count besides.

        Without those that are as near to an edge as the poles that confirm it.
        """
        edges = self.edges
        places = sorted({edges.low, *(edge.value for edge in edges.edges), edges.high})
        between = chain.from_iterable(_between(*ends) for ends in pairwise(places))
        every, beside = {edges.low, edges.high, *self.values}, BESIDE[-1]
        every |= set() if self.precise else {*between}
        if self.count:
            beside = 2.0 * BESIDE[0]
            every |= {at * by for at in edges.near for by in (1.0 - beside, 1.0, 1.0 + beside)}
        return sorted(v for v in every if all(abs(v / e.value - 1.0) > beside for e in edges.edges))

    def agrees(self, value: float, found: Count) -> bool | None:
        """Tell whether as many poles are unstable as the edges say; None where it is not known."""
        claimed, (least, most) = self.edges.unstable_at(value), found
        if not least <= claimed <= most:
            return False
        return True if least == most else None


def _between(low: float, high: float) -> Iterator[float]:
    """Yield values between two edges, or ends of a range, that are at most `WIDE` apart."""
    count = math.ceil(math.log(high / low) / math.log(WIDE))
    return (low * (high / low) ** ((k + 0.5) / count) for k in range(count))


def certify(claims: Sequence[EdgeClaim]) -> list[Edges | None]:
    """Return the edges of each claim with their bounds, or None where poles do not confirm them.

    A sample of which rounding hides the side of a pole comes to the near values. The poles of all
    claims are found together.
    """
    asked = [claim.samples for claim in claims]
    judged = _judged(list(zip(claims, asked, strict=True)))
    refuted = [False in agreed for agreed in judged]
    bounds: list[dict[float, float]] = [{} for _ in claims]
    for distance in BESIDE:
        left = [
            (k, edge.value)
            for k, claim in enumerate(claims)
            for edge in claim.edges.edges
            if not refuted[k]
            and edge.value not in bounds[k]
            and (claim.count or distance >= NEAREST_POLES)
        ]
        sides = [[at * (1.0 - distance), at * (1.0 + distance)] for _, at in left]
        pairs = [(claims[k], beside) for (k, _), beside in zip(left, sides, strict=True)]
        for (k, at), agreed in zip(left, _judged(pairs), strict=True):
            if all(agreed):
                bounds[k][at] = distance * at
    found: list[Edges | None] = []
    for k, claim in enumerate(claims):
        edges = [replace(e, bound=bounds[k].get(e.value, math.inf)) for e in claim.edges.edges]
        if refuted[k] or any(math.isinf(edge.bound) for edge in edges):
            found.append(None)
            continue
        open_ = [at for at, agreed in zip(asked[k], judged[k], strict=True) if agreed is None]
        near = tuple(sorted({*(() if claim.count else claim.edges.near), *open_}))
        found.append(replace(claim.edges, edges=tuple(edges), near=near))
    return found


def _judged(asked: Sequence[tuple[EdgeClaim, list[float]]]) -> list[list[bool | None]]:
    """Return whether each claim agrees with the poles at each of its values."""
    boards = (
        or_error(claim.board, value)
        for claim, values in asked
        if claim.count is None
        for value in values
    )
    poles = iter(poles_together(boards))
    return [
        [
            claim.agrees(
                value, _by_poles(next(poles)) if claim.count is None else _sure(claim.count(value))
            )
            for value in values
        ]
        for claim, values in asked
    ]


def _sure(count: int | None) -> Count:
    return UNKNOWN if count is None else (count, count)


def _by_poles(found: Poles | TactionError) -> Count:
    if isinstance(found, TactionError):
        return UNKNOWN
    least, most = found.unstable_range
    return (least, most if found.complete or not least else math.inf)


def counted_edges(claim: EdgeClaim) -> Edges:
    """Return the edges of a deck by counts at many values, and by halving between two that differ.

    Two crossings nearer than the values that cancel each other are those of the claim, or none.
    """
    count, found = claim.count, claim.edges
    assert count is not None  # noqa: S101 - only of decks
    low, high = found.low, found.high
    steps = 1 + math.ceil(GRID * math.log10(high / low))
    beside = [e.value * (1.0 + by) for e in found.edges for by in (-BESIDE[0], BESIDE[0])]
    grid = [low * (high / low) ** (k / steps) for k in range(1, steps)]
    known, near = list[tuple[float, int]](), list[float]()
    for value in sorted({low, *grid, *beside, *claim.values, high}):
        if (unstable := count(value)) is None:
            near.append(value)
        else:
            known.append((value, unstable))
    edges = list[Edge]()
    for (a, below), (b, above) in pairwise(known):
        edges += _halved(count, a, b, below, above, claim.board) if below != above else []
    inside = tuple(at for at in near if not any(abs(at - e.value) <= e.bound for e in edges))
    return Edges(low, high, tuple(edges), inside, known[0][1] if known else 0)


def _halved(
    count: ExactCount,
    a: float,
    b: float,
    below: int,
    above: int,
    board: Callable[[float], LinearBoard],
) -> list[Edge]:
    """Return the edges between two values with different counts."""
    while b - a > BESIDE[0] * b:
        middle = math.sqrt(a * b)
        between = count(middle)
        if between is None:
            break
        if between not in (below, above):
            left = _halved(count, a, middle, below, between, board)
            return left + _halved(count, middle, b, between, above, board)
        a, b = (middle, b) if between == below else (a, middle)
    value = 0.5 * (a + b)
    (poles,) = poles_together([board(value)])
    frequency = 0.0
    if isinstance(poles, Poles) and (above - below) % 2 == 0:
        upper = poles.poles[poles.poles.imag >= 0.0]
        frequency = float(upper[abs(upper.real).argmin()].imag) / math.tau if len(upper) else 0.0
    return [Edge(value, frequency, below, above, b - a)]
