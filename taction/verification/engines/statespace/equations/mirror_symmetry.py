"""Split the equations of boards that are their own mirror image (first channel for the last, ...).

Most boards are: they have a symmetric kernel between evenly spaced channels and sensors. Then every
matrix of the board commutes with the exchange, and splits exactly into a matrix for even vectors
and one for odd vectors, each of half the size: an eigenproblem costs a quarter. The names only
propose the exchange; the split is used if the exchanged matrices are equal to the bit. What works
on the equations works on a list of blocks, of which most boards without an image have one.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Bools, Floats, Ints

_NUMBERED = re.compile(r"^([^\d\n]*)(\d*)(.*)$", re.MULTILINE)


def numbered_kinds(names: tuple[str, ...]) -> list[Ints]:
    """Return the places of the unknowns of each kind, by number: ``v_1``, ``v_2``, for example."""
    kinds: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for place, (head, number, tail) in enumerate(_NUMBERED.findall("\n".join(names))):
        if number:
            kinds.setdefault((head, tail), []).append((int(number), place))
        else:
            kinds[head, tail] = [(0, place)]
    return [np.array([place for _, place in sorted(kind)]) for kind in kinds.values()]


@functools.lru_cache(maxsize=16)
def proposed_mirror(names: tuple[str, ...]) -> Ints | None:
    """Return the place of each unknown's image by name: ``v_7`` for ``v_1``; None of no image."""
    image, own = np.arange(len(names)), np.arange(len(names))
    for kind in numbered_kinds(names):
        image[kind] = kind[::-1]
    return None if np.array_equal(image, own) else image


def exchange_bases(image: Ints) -> tuple[Floats, Floats]:
    """Return bases of the vectors that are even under an exchange, and of the odd ones."""
    every, places = np.eye(len(image)), np.arange(len(image))
    lower = np.flatnonzero(image > places)
    one, other = every[:, lower], every[:, image[lower]]
    return np.hstack([one + other, every[:, image == places]]), one - other


def block_diagonal(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return the matrix that has `parts` along its diagonal, and zeros elsewhere."""
    found = np.zeros(np.sum([part.shape for part in parts], axis=0), dtype=np.result_type(*parts))
    row = column = 0
    for part in parts:
        found[row : row + len(part), column : column + part.shape[1]] = part
        row, column = row + len(part), column + part.shape[1]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class DenseBlock:
    """Equations that are solved by themselves: ``z = basis y`` obeys ``mass y' = stiffness y``."""

    # `basis`, `left`: vectors of all unknowns z as columns, and the rows that find ``y = left z``
    # again.
    basis: Floats
    left: Floats
    places: Ints  # (k,): unknowns whose equations it has
    # `mass`, `stiffness`: (k, k): those of the board in these vectors.
    mass: Floats
    stiffness: Floats


@dataclass(frozen=True, eq=False)
class DenseMatrix:
    """M and K of a board, read-only, and the images of its unknowns if it is its own image."""

    mass: Floats
    stiffness: Floats
    image: Ints | None

    @classmethod
    def of(cls, M: Floats, K: Floats, determined: Bools, image: Ints | None) -> DenseMatrix:
        """Make M and K read-only; keep the proposed `image` if all matrices commute with it."""
        M.flags.writeable = K.flags.writeable = False
        if image is not None and not np.array_equal(determined, determined[image]):
            image = None
        return cls(M, K, image if _commute(image, K) and _commute(image, M) else None)

    @functools.cached_property
    def blocks(self) -> tuple[DenseBlock, ...]:
        """The board as one block, or its even and its odd part."""
        every = np.eye(len(self.mass))
        bases = (every,) if self.image is None else exchange_bases(self.image)
        return tuple(map(self._block, bases))

    def _block(self, basis: Floats) -> DenseBlock:
        places, left = basis.argmax(axis=0), basis.T / (basis**2).sum(axis=0)[:, None]
        mass, stiffness = (A[places] @ basis for A in (self.mass, self.stiffness))
        return DenseBlock(basis, left, places, mass, stiffness)


def _commute(image: Ints | None, A: Floats) -> bool:
    """Tell whether a matrix is the same to the bit after the exchange of rows and columns."""
    return image is not None and np.array_equal(A, A[image][:, image])
