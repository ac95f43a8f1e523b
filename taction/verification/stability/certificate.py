"""Poles at samples of a range certify the edges that loci show there.

Loci follow from the modes of one board, so poles many decades apart can blind them. Poles of the
boards at the ends of the range, between its edges, and beside each edge, have bounds of their own:
a count that differs from what the edges say is a crossing that the loci missed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np

from taction.system.errors import TactionError
from taction.system.frozen import frozen
from taction.verification.engines.statespace.equations.exact_count import exact_unstable_count
from taction.verification.engines.statespace.linearised.board import LinearBoard, stamp_boards
from taction.verification.stability.edges import Edges
from taction.verification.stability.poles import Poles, or_error, poles_together

BESIDE = (1e-9, 1e-6, 1e-3)  # relative distances of the poles that confirm an edge: the first to do
WIDE = 30.0  # largest ratio of neighbouring samples
Count = tuple[float, float]  # least and largest number
UNKNOWN: Count = (0, math.inf)


@frozen(eq=False)
class Claim:
    """Edges over a value above zero, the board at a value, and values that count besides."""

    edges: Edges
    board: Callable[[float], LinearBoard]
    values: tuple[float, ...] = ()

    @property
    def samples(self) -> list[float]:
        """Values at the ends, between the edges, and those that count besides.

        Without those that are as near to an edge as the poles that confirm it.
        """
        edges = self.edges
        places = sorted({edges.low, *(edge.value for edge in edges.edges), edges.high})
        between = chain.from_iterable(_between(*ends) for ends in pairwise(places))
        every = {edges.low, *between, edges.high, *self.values}
        beside = [edge.value for edge in edges.edges]
        return sorted(v for v in every if all(abs(v / e - 1.0) > BESIDE[-1] for e in beside))

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


def certify(claims: Sequence[Claim]) -> list[Edges | None]:
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
            if not refuted[k] and edge.value not in bounds[k]
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
        near = tuple(sorted({*claim.edges.near, *open_}))
        found.append(replace(claim.edges, edges=tuple(edges), near=near))
    return found


def _judged(asked: Sequence[tuple[Claim, list[float]]]) -> list[list[bool | None]]:
    """Return whether each claim agrees with the poles at each of its values."""
    boards = [or_error(claim.board, value) for claim, values in asked for value in values]
    counts = iter(_counts(boards))
    return [[claim.agrees(value, next(counts)) for value in values] for claim, values in asked]


def _counts(boards: Sequence[LinearBoard | TactionError]) -> list[Count]:
    """Return the least and the largest number of unstable poles of each board, exact for a deck."""
    made = [board for board in boards if isinstance(board, LinearBoard)]
    stamp_boards(made)
    exact = {board: or_error(_exact, board) for board in made}
    found = {board: each for board, each in exact.items() if isinstance(each, tuple)}
    left = [board for board in made if board not in found]
    found |= zip(left, map(_by_poles, poles_together(left)), strict=True)
    return [UNKNOWN if isinstance(each, TactionError) else found[each] for each in boards]


def _exact(board: LinearBoard) -> Count | None:
    descriptor = board.descriptor
    if not descriptor.has_branches or descriptor.devices.count:
        return None
    count = exact_unstable_count(descriptor, np.zeros(0))
    return None if count is None else (count, count)


def _by_poles(found: Poles | TactionError) -> Count:
    if isinstance(found, TactionError):
        return UNKNOWN
    least, most = found.unstable_range
    return (least, most if found.complete or not least else math.inf)
