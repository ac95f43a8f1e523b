"""Split the equations of boards that are their own mirror image (first channel for the last, ...).

Most boards are: they have a symmetric kernel between evenly spaced channels and sensors. Then every
matrix of the board commutes with the exchange, and splits exactly into a matrix for even vectors
and one for odd vectors, each of half the size: an eigenproblem costs a quarter. The names only
propose the exchange; the split is used if the exchanged matrices are equal to the bit.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints

_NUMBERED = re.compile(r"^([^\d\n]*)(\d*)(.*)$", re.MULTILINE)
ROUNDING = 64 * EPS  # relative error of Newton's method in a slope


def numbered_kinds(names: tuple[str, ...]) -> list[Ints]:
    """Return the places of the unknowns of each kind, by number: ``v_1``, ``v_2``, for example."""
    kinds: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for place, (head, number, tail) in enumerate(_NUMBERED.findall("\n".join(names))):
        if number:
            kinds.setdefault((head, tail), []).append((int(number), place))
        else:
            kinds[head, tail] = [(0, place)]
    return [np.array([place for _, place in sorted(kind)]) for kind in kinds.values()]


def proposed_image(names: tuple[str, ...]) -> Ints:
    """Return the place of each unknown's mirror image by name: ``v_7`` for ``v_1``, for example."""
    image = np.arange(len(names))
    for kind in numbered_kinds(names):
        image[kind] = kind[::-1]
    return image


@functools.lru_cache(maxsize=16)
def proposed_mirror(names: tuple[str, ...]) -> Halves | None:
    """Return the exchange of all unknowns with their images; None if each is its own image."""
    image = proposed_image(names)
    return None if np.array_equal(image, np.arange(len(image))) else Halves.of(image)


def image_within(places: Ints, image: Ints) -> Ints | None:
    """Return the exchange among some places; None if it leaves them or is the identity."""
    position = np.full(len(image), -1)
    position[places] = np.arange(len(places))
    inside = position[image[places]]
    if np.any(inside < 0) or np.array_equal(inside, np.arange(len(places))):
        return None
    return inside


def evened(values: Floats, places: Ints, mirror: Halves | None) -> Floats:
    """Return values at `places`, averaged over images if they differ only by rounding."""
    inside = None if mirror is None else image_within(places, mirror.mirror)
    if inside is None:
        return values
    mean = 0.5 * (values + values[inside])
    return mean if np.all(np.abs(values - mean) <= ROUNDING * np.abs(mean)) else values


@dataclass(frozen=True, eq=False)
class Halves:
    """The even and the odd part of vectors and matrices under an exchange.

    An even vector is given by its values at `first`, an odd one by those at ``first[:pairs]``.

    Attributes
    ----------
    first, second : ndarray of int
        One place of each pair, or the other place; then the places without another image.
    pairs : int
        Number of pairs.
    mirror : ndarray of int (n,)
        Place of each place's mirror image.
    """

    first: Ints
    second: Ints
    pairs: int
    mirror: Ints

    @classmethod
    def of(cls, mirror: Ints) -> Halves:
        """Return the halves of an exchange, given the place of each mirror image."""
        places = np.arange(len(mirror))
        lower, fixed = np.flatnonzero(mirror > places), np.flatnonzero(mirror == places)
        first = np.concatenate([lower, fixed])
        return cls(first, mirror[first], len(lower), mirror)

    def within(self, chosen: Ints) -> tuple[Ints, Halves]:
        """Return the places that a choice among `first` represents, and the exchange among them."""
        first, second = self.first[chosen], self.second[chosen]
        places = np.sort(np.concatenate([first, second[chosen < self.pairs]]))
        first, second = np.searchsorted(places, first), np.searchsorted(places, second)
        mirror = np.empty_like(places)
        mirror[first], mirror[second] = second, first
        return places, Halves(first, second, len(places) - len(first), mirror)

    def commute_with(self, A: Floats) -> bool:
        """Whether a matrix is the same to the bit after the exchange of rows and columns."""
        return np.array_equal(A[self.first], A[self.second][:, self.mirror])

    @property
    def share(self) -> Floats:
        """Weight of each place in an even row: 1/2 if the row represents two, (len(first),)."""
        return np.where(np.arange(len(self.first)) < self.pairs, 0.5, 1.0)

    def split(self, A: Floats) -> tuple[Floats, Floats]:
        """Return the matrices that act on even and on odd vectors."""
        return self.split_rows(A[self.first], self.pairs)

    def split_rows(self, C: Floats, odd: int | None = None) -> tuple[Floats, Floats]:
        """Return the rows that act on even and (only the first `odd` rows) on odd vectors."""
        direct, crossed = C[:, self.first], C[:, self.second[: self.pairs]]
        difference = direct[:odd, : self.pairs] - crossed[:odd]
        direct[:, : self.pairs] += crossed
        return direct, difference

    def split_vectors(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the even and the odd part of a vector, or of the columns of an array."""
        first, second = x[self.first], x[self.second]
        return 0.5 * (first + second), 0.5 * (first - second)[: self.pairs]

    def join_vectors(self, even: Floats, odd: Floats) -> Floats:
        """Undo `split_vectors`."""
        whole = np.empty((len(self.mirror), *even.shape[1:]))
        whole[self.first] = whole[self.second] = even
        whole[self.first[: self.pairs]] += odd
        whole[self.second[: self.pairs]] -= odd
        return whole

    def join_rows(self, even: Floats, odd: Floats) -> Floats:
        """Undo `split_rows`."""
        whole = np.empty((len(even), len(self.mirror)))
        whole[:, self.first] = even
        half = 0.5 * even[:, : self.pairs]
        whole[:, self.first[: self.pairs]] = half + 0.5 * odd
        whole[:, self.second[: self.pairs]] = half - 0.5 * odd
        return whole

    @functools.cached_property
    def _rank(self) -> tuple[Ints, Floats]:
        """For every place: its index in `first`, and the sign of an odd vector there."""
        rank, sign = np.empty(len(self.mirror), dtype=np.int64), np.zeros(len(self.mirror))
        rank[self.first] = rank[self.second] = np.arange(len(self.first))
        sign[self.first[: self.pairs]], sign[self.second[: self.pairs]] = 1.0, -1.0
        return rank, sign

    def rows_at(
        self, places: slice | list[int], even: Floats, odd: Floats
    ) -> tuple[Floats, Floats]:
        """Return the contributions of a matrix's two parts to its rows at some places."""
        rank, sign = (each[places] for each in self._rank)
        return even[rank], odd[np.minimum(rank, self.pairs - 1)] * sign[:, None]

    def join(self, even: Complexes, odd: Complexes) -> Complexes:
        """Return even, then odd vectors (columns) on all places."""
        whole = np.zeros((len(self.first) + self.pairs,) * 2, dtype=np.complex128)
        count = even.shape[1]
        whole[self.first, :count] = even
        whole[self.second, :count] = even
        whole[self.first[: self.pairs], count:] = odd
        whole[self.second[: self.pairs], count:] = -odd
        return whole


@dataclass(frozen=True, eq=False)
class DenseMatrix:
    """M and K of a board, read-only, and their halves if the board is its own mirror image."""

    mass: Floats
    stiffness: Floats
    halves: Halves | None

    @classmethod
    def of(cls, M: Floats, K: Floats, determined: Bools, mirror: Halves | None) -> DenseMatrix:
        """Make M and K read-only; keep the proposed `mirror` if all matrices commute with it."""
        M.flags.writeable = K.flags.writeable = False
        if mirror is not None:
            alike = np.array_equal(determined, determined[mirror.mirror])
            if not (alike and mirror.commute_with(K) and mirror.commute_with(M)):
                mirror = None
        return cls(M, K, mirror)

    @functools.cached_property
    def blocks(self) -> tuple[tuple[Floats, Floats], ...]:
        """M and K; with halves, M and K for even vectors, then for odd ones."""
        if self.halves is None:
            return ((self.mass, self.stiffness),)
        split = self.halves.split
        return tuple(zip(split(self.mass), split(self.stiffness), strict=True))

    def with_stiffness(self, K: Floats) -> DenseMatrix:
        """Return the board with another K; without halves if K is not symmetric."""
        halves = self.halves if self.halves is None or self.halves.commute_with(K) else None
        return DenseMatrix(self.mass, K, halves)
