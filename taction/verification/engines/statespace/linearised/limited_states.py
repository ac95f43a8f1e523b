"""States that equations without charge limit, such as a coil in series with a current source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.scaled_inverse import (
    ScaledInverse,
    matching_scales,
    pivoted,
)

ROUNDS = 20  # of scaling rows and columns by the roots of their largest elements


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """States x (n,) that equations without charge limit: ``x = free y + fixed u``, y = kept x.

    A coil in series with a current source is such a limit, and a loop of capacitors and sources. An
    impulse that a step makes there does not change y. The unknowns without charge are
    ``-passive [x, u]``, and as far as they move y ``-fixing [x, u]``.
    """

    free: Floats
    fixed: Floats
    kept: Floats
    fixing: Floats
    passive: Floats

    def restricted(
        self, rates: Floats, outer: Floats, sizes: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return what the states' rates and the unknowns are as functions of y."""
        n, inputs = self.fixed.shape
        A, B, charge = np.split(rates[0], [n, n + inputs], axis=1)
        C, D = np.split(outer[0], [n], axis=1)
        own = [self.kept @ part for part in (A @ self.free, A @ self.fixed + B, charge)]
        after = [C @ self.free, C @ self.fixed + D]
        sizes = np.abs(self.kept) @ sizes @ np.abs(self.free)
        return np.hstack(own)[None], np.hstack(after)[None], sizes


def _scales(A: Floats) -> tuple[Floats, Floats]:
    """Return divisors of rows and columns, of a matrix without any matching, too."""
    rows, columns = matching_scales(A)
    if np.all(rows == 1.0) and np.all(columns == 1.0):
        for _ in range(ROUNDS):
            left = np.abs(A / rows[:, None] / columns)
            rows = rows * np.where(left.any(axis=1), np.sqrt(left.max(axis=1, initial=0.0)), 1.0)
            left = np.abs(A / rows[:, None] / columns)
            most = np.sqrt(left.max(axis=0, initial=0.0))
            columns = columns * np.where(left.any(axis=0), most, 1.0)
    return rows, columns


def limits_of(K: Floats, mass: ScaledInverse, n: int, inputs: int) -> Limits | None:
    """Return what limits the states; None where the equations are singular for another reason.

    The equations without charge are those below the first n. They leave directions of their
    unknowns open, which the derivative of what limits the states determines. These move no y, and
    do not enter its rates, else these would be differences of large numbers.
    """
    from scipy.linalg import qr, solve_triangular

    rows, columns = _scales(K[0, n:, n + inputs :])
    own = K[0, n:] / rows[:, None]
    L, U, p, q, r = pivoted(own[:, n + inputs :] / columns)
    first = solve_triangular(L[:r, :r], own[p[:r], : n + inputs], lower=True, unit_diagonal=True)
    limit, k = own[p[r:], : n + inputs] - L[r:, :r] @ first, len(p) - r
    fixing, right = np.zeros((len(p), n + inputs)), np.zeros((len(p), k))
    fixing[q[:r]] = solve_triangular(U[:r, :r], first)
    right[q] = np.vstack([-solve_triangular(U[:r, :r], U[:r, r:]), np.eye(k)])
    fixing, right = fixing / columns[:, None], right / columns[:, None]
    rates = mass.solve(K[:, :n], [str(i) for i in range(n)], "singular capacitances")[0]
    through = rates[:, n + inputs :] @ right
    pivots = qr(limit[:, :n], mode="r", pivoting=True)[1][:k]
    others = np.setdiff1d(np.arange(n), pivots)
    try:
        moved = limit[:, :n] @ through
        if k > n or np.linalg.cond(moved) > 1.0 / EPS:
            return None
        free = np.zeros((n, n - k))
        free[others, np.arange(n - k)] = 1.0
        free[pivots] = -np.linalg.solve(limit[:, pivots], limit[:, others])
        fixed = -through @ np.linalg.solve(moved, limit[:, n:])
        whole = np.hstack([free, through])
        kept = ScaledInverse(whole[None]).solve(np.eye(n)[None], ["state"], "states")[0, : n - k]
        after = limit[:, :n] @ (rates[:, : n + inputs] - rates[:, n + inputs :] @ fixing)
        return Limits(free, fixed, kept, fixing, fixing + right @ np.linalg.solve(moved, after))
    except (np.linalg.LinAlgError, EngineError):
        return None
