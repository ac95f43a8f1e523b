"""The search for the active set of a regulariser of straight pieces.

Each entry of u is at a break (a bound, or 0 where ``|u|`` has its corner) or free between two. The
search is that of Lawson and Hanson (Solving Least Squares Problems, chapter 23): the entry whose
condition is violated most is freed, and a step to the new minimum ends at the first break. The
objective falls with each step, so no set comes back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.errors import SolverError
from taction.verification.reference.scaled_problem import ScaledProblem
from taction.verification.reference.stacked_least_squares import SVD

STEPS_PER_ENTRY = 20  # of the search, before it gives up
VIOLATED = 64.0 * EPS  # of the terms of a condition: a smaller violation is rounding
FAR = 1e6  # length of a step along which the objective only falls


@dataclass(slots=True)
class ActiveSet:
    """Where each entry of u is: at a break, or free in the interval to the right of a break.

    Attributes
    ----------
    breaks : ndarray (k,)
        Increasing.
    slopes : ndarray (k + 1,)
        Of phi without its ridge term, in the intervals from left to right; infinite outside bounds.
    place : ndarray of int (N,)
        Number of the break, or of the interval.
    free : ndarray of bool (N,)
        Whether it is the number of an interval.
    u : ndarray (N,)
        Values.
    """

    breaks: Floats
    slopes: Floats
    place: Ints
    free: Bools
    u: Floats

    @classmethod
    def of(cls, s: ScaledProblem) -> ActiveSet:
        """Return the start: all entries 0, and free where there are no pieces."""
        pieces = s.regulariser.pieces
        count = len(s.h)
        if pieces is None:
            whole = np.full(count, True)
            return cls(np.zeros(0), np.zeros(1), np.zeros(count, int), whole, np.zeros(count))
        corner = [0.0] if pieces.size > 0.0 else []
        finite = {x for x in (pieces.low, pieces.high, *corner) if np.isfinite(x)}
        breaks = np.array(sorted(finite))
        middles = np.concatenate(
            [breaks[:1] - 1.0, 0.5 * (breaks[1:] + breaks[:-1]), breaks[-1:] + 1.0]
        )
        slopes = pieces.size * np.sign(middles)
        slopes[middles < pieces.low], slopes[middles > pieces.high] = -np.inf, np.inf
        at = int(np.searchsorted(breaks, 0.0))
        free = not (at < len(breaks) and breaks[at] == 0.0)
        return cls(breaks, slopes, np.full(count, at), np.full(count, free), np.zeros(count))

    @property
    def slope(self) -> Floats:
        """Slope of phi at the free entries, (free,)."""
        return self.slopes[self.place[self.free]]

    def limits(self) -> tuple[Floats, Floats]:
        """Return the ends of the intervals of the free entries, (free,) each."""
        ends = np.concatenate([[-np.inf], self.breaks, [np.inf]])
        where = self.place[self.free]
        return ends[where], ends[where + 1]

    def hold(self, entries: Ints, upper: Bools) -> None:
        """Put free entries on the upper or lower break of their intervals."""
        self.place[entries] -= ~upper
        self.free[entries] = False
        self.u[entries] = self.breaks[self.place[entries]]

    def release(self, entry: int, *, upwards: bool) -> None:
        """Free an entry into the interval above or below its break."""
        self.place[entry] += int(upwards)
        self.free[entry] = True

    def excess(self, force: Floats, mu: float) -> tuple[Floats, Bools]:
        """Return by how much the `force` (N,) on entries at breaks exceeds what holds them there.

        Negative where they are held; the second result tells whether the force is upwards. -inf for
        free entries.
        """
        held = ~self.free
        above, below = np.full(len(force), -np.inf), np.full(len(force), -np.inf)
        where = self.place[held]
        above[held] = force[held] - mu * self.slopes[where + 1]
        below[held] = mu * self.slopes[where] - force[held]
        return np.maximum(above, below), above > below


def search(s: ScaledProblem, ridge: float, state: ActiveSet) -> int:
    """Move `state` to the minimum; return the steps taken.

    Raises
    ------
    SolverError
        The search does not end.
    """
    blocked = np.zeros(len(s.h), dtype=np.bool_)  # entries that rounding alone would free
    entry = -1
    for step in range(STEPS_PER_ENTRY * len(s.h) + 100):
        before = state.u.copy()
        _minimise(s, ridge, state)
        if np.array_equal(state.u, before) and entry >= 0:
            blocked[entry] = True
        else:
            blocked[:] = False
        residual = s.eps - s.T @ state.u
        force = residual @ s.T - s.mu * (ridge * state.u + s.beta)
        size = np.abs(s.T).T @ np.abs(residual) + s.mu * (
            ridge * np.abs(state.u) + abs(s.beta) + 1.0
        )
        excess, upwards = state.excess(force, s.mu)
        excess[blocked | (excess <= VIOLATED * size)] = -np.inf
        entry = int(np.argmax(excess))
        if excess[entry] == -np.inf:
            return step
        state.release(entry, upwards=bool(upwards[entry]))
    raise SolverError("the search for the active set does not end: the entries depend on rounding")


def _minimise(s: ScaledProblem, ridge: float, state: ActiveSet) -> None:
    """Step to the minimum over the free entries, holding those that reach a break on the way."""
    while state.free.any():
        free = np.flatnonzero(state.free)
        A, f2 = s.T[:, free], -s.mu * (state.slope + s.beta)
        held = np.where(state.free, 0.0, state.u)
        f1 = s.eps - s.T @ held
        factor = SVD(A, s.mu * ridge)
        goal = factor.solve(f1, f2)
        if factor.least == 0.0:  # dependent columns: along them only the slopes of phi count
            hidden = factor.along_null(f2)
            size = float(np.abs(hidden).max())
            if size > 1e-9 * float(np.abs(f2).max()):
                goal = goal + FAR / size * hidden
        low, high = state.limits()
        way, now = goal - state.u[free], state.u[free]
        room = np.where(way > 0.0, high - now, now - low)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(way == 0.0, np.inf, room / np.abs(way))
        first = float(share.min())
        if first > 1.0:
            state.u[free] = goal
            return
        state.u[free] = now + max(first, 0.0) * way
        stop = share <= first
        state.hold(free[stop], way[stop] > 0.0)
