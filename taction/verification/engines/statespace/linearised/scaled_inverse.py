"""Inverses of matrices with scaled rows and columns."""

from __future__ import annotations

import numpy as np

from taction.system.array_types import Floats, Ints

SINGULAR = 1e13  # condition number of a scaled matrix above which it counts as singular
CHAINED = 1e9  # condition number from which columns are scaled, too


def scaled_inverse(A: Floats) -> tuple[Floats, float]:
    """Return the inverse of A (k, k), and the condition number of the scaled matrix.

    Rows are scaled; where they alone do not scale a chain of gains, columns, too. The condition
    number is that of the row-sum norm, infinite of a singular matrix.
    """
    rows = np.abs(A).max(axis=1, initial=0.0)
    rows[rows == 0.0] = 1.0
    found = _with_scales(A, rows, np.ones_like(rows))
    if found[1] < CHAINED:
        return found
    better = _with_scales(A, *matching_scales(A))
    return better if better[1] < found[1] else found


def _with_scales(A: Floats, rows: Floats, columns: Floats) -> tuple[Floats, float]:
    scaled = A / rows[:, None] / columns
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        return np.full_like(A, np.inf), np.inf
    norms = [np.abs(X).sum(axis=1).max(initial=1.0) for X in (scaled, inverse)]
    return inverse / rows / columns[:, None], float(norms[0] * norms[1])


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


def pivoted(A: Floats) -> tuple[Floats, Floats, Ints, Ints, int]:
    """Return L, U, p, q and the rank r of A: ``A[p][:, q] = L U`` by complete pivoting.

    What is zero stays zero, where singular vectors have rounding, times the largest elements.
    """
    L, U, size = np.eye(len(A)), A.copy(), len(A)
    p, q = np.arange(size), np.arange(size)
    for r in range(size):
        i, j = (r + place for place in divmod(int(np.abs(U[r:, r:]).argmax()), size - r))
        if abs(U[i, j]) * SINGULAR <= abs(U[0, 0]):
            return L, U, p, q, r
        for X in (U, p):
            X[[r, i]] = X[[i, r]]
        L[[r, i], :r] = L[[i, r], :r]
        U[:, [r, j]], q[[r, j]] = U[:, [j, r]], q[[j, r]]
        L[r + 1 :, r] = U[r + 1 :, r] / U[r, r]
        U[r + 1 :] -= np.outer(L[r + 1 :, r], U[r])
    return L, U, p, q, size
