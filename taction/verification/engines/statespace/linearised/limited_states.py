"""States that equations without charge limit, such as a coil in series with a current source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.scaled_inverse import (
    SINGULAR,
    ScaledInverse,
    matching_scales,
)

ROUNDS = 20  # of scaling rows and columns by the roots of their largest elements


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """States x (n,) that equations without charge limit: ``x = free y + fixed u``, y = kept x.

    A coil in series with a current source is such a limit, and a loop of capacitors and sources. An
    impulse that a step makes there does not change y.
    """

    free: Floats
    fixed: Floats
    kept: Floats

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


def differentiated(
    K: Floats, mass: ScaledInverse, n: int, inputs: int
) -> tuple[Floats, Limits | None]:
    """Put the derivative of what limits the states in the place of each equation that only does.

    The equations without charge are those below the first n; where they are singular for another
    reason, K comes back as it is.
    """
    from scipy.linalg import qr

    rows, columns = _scales(K[0, n:, n + inputs :])
    own = K[0, n:] / rows[:, None]
    U, S, Vt = np.linalg.svd(own[:, n + inputs :] / columns)
    k = int(np.sum(S[0] >= S * SINGULAR))
    left, right = U[:, len(S) - k :], Vt[len(S) - k :].T / columns[:, None]
    limit = left.T @ own[:, : n + inputs]
    rates = mass.solve(K[:, :n], [str(i) for i in range(n)], "singular capacitances")[0]
    through = rates[:, n + inputs :] @ right
    pivots = qr(limit[:, :n], mode="r", pivoting=True)[1][:k]
    others = np.setdiff1d(np.arange(n), pivots)
    try:
        if k > n or np.linalg.cond(limit[:, :n] @ through) > 1.0 / EPS:
            return K, None
        free = np.zeros((n, n - k))
        free[others, np.arange(n - k)] = 1.0
        free[pivots] = -np.linalg.solve(limit[:, pivots], limit[:, others])
        fixed = -through @ np.linalg.solve(limit[:, :n] @ through, limit[:, n:])
        whole = np.hstack([free, through])
        kept = ScaledInverse(whole[None]).solve(np.eye(n)[None], ["state"], "states")[0, : n - k]
    except (np.linalg.LinAlgError, EngineError):
        return K, None
    after = limit[:, :n] @ rates
    after /= np.abs(after[:, n + inputs :]).max(axis=1, keepdims=True)
    made = np.vstack([K[0, :n], U[:, : len(S) - k].T @ own, after])
    return made[None], Limits(free, fixed, kept)
