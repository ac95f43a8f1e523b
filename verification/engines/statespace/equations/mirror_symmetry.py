"""Boards that are their own mirror image: the last channel for the first, and so on.

Most are: a symmetric kernel between evenly spaced channels and sensors. Then every matrix of the
board commutes with the exchange, and splits exactly into one that acts on what is even under it
and one that acts on what is odd, each of half the size: an eigenproblem costs a quarter.
Names only propose the exchange; it counts if the matrices are the same to the bit.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Bools, Complexes, Floats, Ints

_NUMBERED = re.compile(r"^([^\d\n]*)(\d*)(.*)$", re.MULTILINE)
ROUNDING = 64 * np.finfo(np.float64).eps  # to which Newton's method finds an amplifier's slope


def proposed_image(names: tuple[str, ...]) -> Ints:
    """Place of each unknown's mirror image, by name: that of ``v_1`` may be ``v_7``."""
    image = list(range(len(names)))
    kinds: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for place, (head, number, tail) in enumerate(_NUMBERED.findall("\n".join(names))):
        if number:
            kinds.setdefault((head, tail), []).append((int(number), place))
    for kind in kinds.values():
        kind.sort()
        for (_, place), (_, other) in zip(kind, reversed(kind), strict=True):
            image[place] = other
    return np.array(image, dtype=np.int64)


def proposed_mirror(names: tuple[str, ...]) -> Halves | None:
    """Return the exchange of all unknowns for their images; None if it moves nothing."""
    image = proposed_image(names)
    return None if np.array_equal(image, np.arange(len(image))) else Halves.of(image)


def image_within(places: Ints, image: Ints) -> Ints | None:
    """Return the exchange among some places only, or None if it leaves them or moves nothing."""
    spot = np.full(len(image), -1)
    spot[places] = np.arange(len(places))
    inside = spot[image[places]]
    if np.any(inside < 0) or np.array_equal(inside, np.arange(len(places))):
        return None
    return inside


def evened(values: Floats, places: Ints, mirror: Halves | None) -> Floats:
    """Return the values at `places`, the same for images whose values differ by rounding alone."""
    inside = None if mirror is None else image_within(places, mirror.mirror)
    if inside is None:
        return values
    mean = 0.5 * (values + values[inside])
    return mean if np.all(np.abs(values - mean) <= ROUNDING * np.abs(mean)) else values


@dataclass(frozen=True, eq=False)
class Halves:
    """The even and the odd part of what commutes with an exchange.

    An even vector is given by its values at `own`, an odd one by those at ``own[:pairs]``.

    Attributes
    ----------
    own : ndarray of int
        One place of each pair, then the places that are their own image.
    image : ndarray of int
        The other places of the pairs, then the same places again.
    pairs : int
        How many pairs.
    mirror : ndarray of int (n,)
        Place of each place's mirror image.
    """

    own: Ints
    image: Ints
    pairs: int
    mirror: Ints

    @classmethod
    def of(cls, mirror: Ints) -> Halves:
        """Make it from the place of each place's mirror image."""
        places = np.arange(len(mirror))
        first, alone = np.flatnonzero(mirror > places), np.flatnonzero(mirror == places)
        own = np.concatenate([first, alone])
        return cls(own, mirror[own], len(first), mirror)

    def within(self, chosen: Ints) -> tuple[Ints, Halves]:
        """Return the places that a choice among `own` stands for, and the exchange among them."""
        own, image = self.own[chosen], self.image[chosen]
        places = np.sort(np.concatenate([own, image[chosen < self.pairs]]))
        own, image = np.searchsorted(places, own), np.searchsorted(places, image)
        mirror = np.empty_like(places)
        mirror[own], mirror[image] = image, own
        return places, Halves(own, image, len(places) - len(own), mirror)

    def commute_with(self, A: Floats) -> bool:
        """Whether a matrix is the same to the bit after the exchange of rows and columns."""
        return np.array_equal(A[self.own], A[self.image][:, self.mirror])

    @property
    def share(self) -> Floats:
        """How much an even row has of each place: half where it stands for two, (len(own),)."""
        return np.where(np.arange(len(self.own)) < self.pairs, 0.5, 1.0)

    def split(self, A: Floats) -> tuple[Floats, Floats]:
        """Return a matrix as it acts on even and on odd vectors."""
        return self.split_rows(A[self.own], self.pairs)

    def split_rows(self, C: Floats, odd: int | None = None) -> tuple[Floats, Floats]:
        """Return rows as they act on even and on odd vectors (the first `odd` rows there)."""
        direct, crossed = C[:, self.own], C[:, self.image[: self.pairs]]
        difference = direct[:odd, : self.pairs] - crossed[:odd]
        direct[:, : self.pairs] += crossed
        return direct, difference

    def split_vectors(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the even and the odd part of a vector, or of the columns of an array."""
        own, image = x[self.own], x[self.image]
        return 0.5 * (own + image), 0.5 * (own - image)[: self.pairs]

    def join_vectors(self, even: Floats, odd: Floats) -> Floats:
        """Undo `split_vectors`."""
        whole = np.empty((len(self.mirror), *even.shape[1:]))
        whole[self.own] = whole[self.image] = even
        whole[self.own[: self.pairs]] += odd
        whole[self.image[: self.pairs]] -= odd
        return whole

    def join_rows(self, even: Floats, odd: Floats) -> Floats:
        """Undo `split_rows`."""
        whole = np.empty((len(even), len(self.mirror)))
        whole[:, self.own] = even
        half = 0.5 * even[:, : self.pairs]
        whole[:, self.own[: self.pairs]] = half + 0.5 * odd
        whole[:, self.image[: self.pairs]] = half - 0.5 * odd
        return whole

    @functools.cached_property
    def _rank(self) -> tuple[Ints, Floats]:
        """For every place: which of `own` stands for it, and how an odd vector counts there."""
        rank, sign = np.empty(len(self.mirror), dtype=np.int64), np.zeros(len(self.mirror))
        rank[self.own] = rank[self.image] = np.arange(len(self.own))
        sign[self.own[: self.pairs]], sign[self.image[: self.pairs]] = 1.0, -1.0
        return rank, sign

    def rows_at(
        self, places: slice | list[int], even: Floats, odd: Floats
    ) -> tuple[Floats, Floats]:
        """Return what the rows of the two parts of a matrix add to its rows at some places."""
        rank, sign = (each[places] for each in self._rank)
        return even[rank], odd[np.minimum(rank, self.pairs - 1)] * sign[:, None]

    def join(self, even: Complexes, odd: Complexes) -> Complexes:
        """Write even and odd vectors, one a column, out on all places; the even ones first."""
        whole = np.zeros((len(self.own) + self.pairs,) * 2, dtype=np.complex128)
        count = even.shape[1]
        whole[self.own, :count] = even
        whole[self.image, :count] = even
        whole[self.own[: self.pairs], count:] = odd
        whole[self.image[: self.pairs], count:] = -odd
        return whole


@dataclass(frozen=True, eq=False)
class Dense:
    """M and K of a board, read-only, and how it splits if it is its own mirror image."""

    mass: Floats
    stiffness: Floats
    halves: Halves | None

    @classmethod
    def of(cls, M: Floats, K: Floats, determined: Bools, mirror: Halves | None) -> Dense:
        """Make it read-only, and split where everything commutes with the `mirror` proposed."""
        M.flags.writeable = K.flags.writeable = False
        if mirror is not None:
            alike = np.array_equal(determined, determined[mirror.mirror])
            if not (alike and mirror.commute_with(K) and mirror.commute_with(M)):
                mirror = None
        return cls(M, K, mirror)

    @functools.cached_property
    def blocks(self) -> tuple[tuple[Floats, Floats], ...]:
        """M and K; or both on even vectors, then both on odd ones."""
        if self.halves is None:
            return ((self.mass, self.stiffness),)
        split = self.halves.split
        return tuple(zip(split(self.mass), split(self.stiffness), strict=True))

    def with_stiffness(self, K: Floats) -> Dense:
        """Return the same with another K, whole if it spoils the symmetry."""
        halves = self.halves if self.halves is None or self.halves.commute_with(K) else None
        return Dense(self.mass, K, halves)
