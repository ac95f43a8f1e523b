"""Inverses of matrices with scaled rows and columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from taction.system.array_types import Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.alike import agreed

SINGULAR = 1e13  # condition number of an equilibrated matrix above which it counts as singular

Matrices = TypeVar("Matrices", Floats, Complexes)


class ScaledInverse:
    """Solver of ``A X = B`` for a stack A (B, k, k): inverses with scaled rows, refined once."""

    def __init__(self, A: Floats) -> None:
        filled = A != 0.0
        diagonal = A.diagonal(axis1=1, axis2=2)
        own = np.arange(A.shape[1])
        filled[:, own, own] = False
        decoupled = agreed((diagonal != 0.0) & ~(filled.any(axis=1) | filled.any(axis=2)))
        self.coupled = np.flatnonzero(~decoupled)
        self.diagonal = np.where(decoupled, diagonal, 1.0)[:, :, None]
        scaled = A.take(self.coupled, axis=1).take(self.coupled, axis=2)
        scale = np.abs(scaled).max(axis=2, initial=0.0)
        scale[scale == 0.0] = 1.0
        self.scale = scale[:, :, None]
        self.columns = np.ones_like(self.scale)
        self._invert(scaled)
        if not np.all(self.largest < SINGULAR):  # rows alone do not scale a chain of gains
            pairs = [matching_scales(each) for each in scaled]
            rows, columns = zip(*pairs, strict=True)
            self.scale, self.columns = np.stack(rows)[:, :, None], np.stack(columns)[:, :, None]
            self._invert(scaled)

    def _invert(self, A: Floats) -> None:
        """Invert the coupled part A with its scaled rows and columns."""
        self.scaled = A / self.scale / self.columns.transpose(0, 2, 1)
        self.inverse = inverses(self.scaled)
        self.largest = np.abs(self.inverse).max(axis=(1, 2), initial=0.0)

    @property
    def condition(self) -> Floats:
        """Condition numbers of the scaled matrices in the row-sum norm, (B,); inf if singular."""
        norms = [
            np.abs(X).sum(axis=2).max(axis=1, initial=1.0) for X in (self.scaled, self.inverse)
        ]
        return np.asarray(norms[0] * norms[1])

    def magnitudes(self) -> Floats:
        """Return the sizes of the elements of the inverses."""
        count, size = self.diagonal.shape[:2]
        inverse, own = np.zeros((count, size, size)), np.arange(size)
        inverse[:, own, own] = 1.0 / np.abs(self.diagonal[:, :, 0])
        part = np.abs(self.inverse) / self.scale.transpose(0, 2, 1) / self.columns
        inverse[:, self.coupled[:, None], self.coupled] = part
        return inverse

    def spread(self, X: Floats) -> Floats:
        """Return ``|A^-1| |A| |X|``: to what the rounding of a solution X is relative."""
        moved, size = np.abs(self.diagonal) * np.abs(X), np.abs(X.take(self.coupled, axis=1))
        moved[:, self.coupled] = self.scale * (np.abs(self.scaled) @ (self.columns * size))
        return np.asarray(self.magnitudes() @ moved)

    def solve(self, B: Floats, names: Sequence[str], failure: str) -> Floats:
        """Return X; for singular A raise EngineError with the names of the unknowns."""
        if not agreed(self.largest < SINGULAR):
            listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
            raise EngineError(f"{failure}: {listed}")
        X = B / self.diagonal
        if self.coupled.size:
            right = B.take(self.coupled, axis=1) / self.scale
            Y = self.inverse @ right
            Y = Y + self.inverse @ (right - self.scaled @ Y)
            X[:, self.coupled] = Y / self.columns
        return X


def matching_scales(A: Floats) -> tuple[Floats, Floats]:
    """Return divisors of rows and columns (k,) of A (k, k) that leave elements of 1 and smaller.

    Those of 1 are a matching of rows with columns, that of the largest product (Duff and Koster,
    SIAM J. Matrix Anal. Appl. 22, 2001). Without such a matching A is singular: ones are returned.
    """
    from scipy.optimize import linear_sum_assignment

    size = len(A)
    with np.errstate(divide="ignore"):
        costs = -np.log(np.abs(A))
    try:
        _, match = linear_sum_assignment(costs)
    except ValueError:
        return np.ones(size), np.ones(size)
    own = costs[np.arange(size), match]
    potentials = np.zeros(size)  # of the columns: shortest distances along the matching
    for _ in range(size):
        shorter = np.minimum(potentials, ((potentials[match] - own)[:, None] + costs).min(axis=0))
        if np.array_equal(shorter, potentials):
            break
        potentials = shorter
    return np.exp(-(own - potentials[match])), np.exp(-potentials)


def pivoted(A: Floats, least: float = 1.0 / SINGULAR) -> tuple[Floats, Floats, Ints, Ints, int]:
    """Return L, U, p, q and the rank r of A: ``A[p][:, q] = L U`` by complete pivoting.

    Pivots up to `least` times the first one count as zero. What is zero stays zero, where singular
    vectors have rounding, times the largest elements.
    """
    L, U, size = np.eye(len(A)), A.copy(), len(A)
    p, q = np.arange(size), np.arange(size)
    for r in range(size):
        i, j = (r + place for place in divmod(int(np.abs(U[r:, r:]).argmax()), size - r))
        if abs(U[i, j]) <= least * abs(U[0, 0]):
            return L, U, p, q, r
        for X in (U, p):
            X[[r, i]] = X[[i, r]]
        L[[r, i], :r] = L[[i, r], :r]
        U[:, [r, j]], q[[r, j]] = U[:, [j, r]], q[[j, r]]
        L[r + 1 :, r] = U[r + 1 :, r] / U[r, r]
        U[r + 1 :] -= np.outer(L[r + 1 :, r], U[r])
    return L, U, p, q, size


def inverses(A: Matrices) -> Matrices:
    """Return the inverses of a stack of matrices; infinite ones of singular matrices."""
    try:
        return np.asarray(np.linalg.inv(A))
    except np.linalg.LinAlgError:
        if len(A) == 1:
            return np.full_like(A, np.inf)
        return np.concatenate([inverses(one[None]) for one in A])
