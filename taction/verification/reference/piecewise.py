"""Solver for regularisers of straight pieces: elastic net, LASSO, non-negative and box limits.

Minimises ``1/2 |T u - eps|^2 + mu sum(size |u| + ridge u^2 / 2 + beta u)`` within bounds of u.
Each entry of u is at a break (a bound, or 0 where ``|u|`` has its corner) or free between two. The
search for this active set is that of Lawson and Hanson (Solving Least Squares Problems, chapter
23): the entry whose condition is violated most is freed, and a step to the new minimum ends at the
first break. The objective falls with each step, so no set comes back.

The free entries then solve a linear least squares problem, refined with residuals of 106 bits. With
E a bound of the gradient that remains at the free entries, and s the least singular value of
``[T_F; sqrt(mu ridge) 1]``, a dual vector exists whose gap is at most ``(E/s)^2 / 2``. Strong
convexity there, and the distances of the conditions at the breaks from their limits, bound every
entry's error by ``4 E / s^2``; entries without such a distance count as free for s.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.errors import SolverError
from taction.verification.reference.doubledouble import PRODUCT_ERROR, DoubleDouble, ExactMatrix
from taction.verification.reference.newton import ScaledProblem
from taction.verification.reference.problem import RELATIVE_ERROR, SMALLEST_SCALE, Problem, Solution
from taction.verification.reference.stacked_least_squares import SVD

STEPS_PER_ENTRY = 20  # of the search, before it gives up
VIOLATED = 64.0 * EPS  # of the terms of a condition: a smaller violation is rounding
REFINEMENTS = 10
ATTEMPTS = 4  # searches: refinement may show that an entry belongs to a break


@dataclass(slots=True)
class _ActiveSet:
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
    def of(cls, s: ScaledProblem) -> _ActiveSet:
        """Return the start: all entries 0."""
        pieces = s.regulariser.pieces
        if pieces is None:
            raise SolverError("the regulariser has no straight pieces")
        corner = [0.0] if pieces.size > 0.0 else []
        finite = {x for x in (pieces.low, pieces.high, *corner) if np.isfinite(x)}
        breaks = np.array(sorted(finite))
        middles = np.concatenate(
            [breaks[:1] - 1.0, 0.5 * (breaks[1:] + breaks[:-1]), breaks[-1:] + 1.0]
        )
        slopes = pieces.size * np.sign(middles)
        slopes[middles < pieces.low], slopes[middles > pieces.high] = -np.inf, np.inf
        count = len(s.h)
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


def _search(s: ScaledProblem, ridge: float, state: _ActiveSet) -> int:
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
        force = s.transposed(residual) - s.mu * (ridge * state.u + s.beta)
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


def _minimise(s: ScaledProblem, ridge: float, state: _ActiveSet) -> None:
    """Step to the minimum over the free entries, holding those that reach a break on the way."""
    while state.free.any():
        free = np.flatnonzero(state.free)
        A, f2 = s.T[:, free], -s.mu * (state.slope + s.beta)
        held = np.where(state.free, 0.0, state.u)
        f1 = s.eps - s.T @ held
        factor = SVD(A, s.mu * ridge)
        goal = factor.solve(f1, f2)
        if factor.least == 0.0:  # dependent columns: along them only the slopes of phi count
            goal = goal + _along_null(A, f2)
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


def _along_null(A: Floats, f2: Floats) -> Floats:
    """Return a far step along what A does not see of f2, or 0."""
    _, sigma, Vt = np.linalg.svd(A, full_matrices=True)
    seen = int(np.count_nonzero(sigma > 4.0 * max(A.shape) * EPS * sigma[0]))
    part = Vt[seen:].T @ (Vt[seen:] @ f2)
    size = float(np.abs(part).max(initial=0.0))
    return part / size * 1e6 if size > 1e-9 * float(np.abs(f2).max(initial=0.0)) else 0.0 * f2


@dataclass(frozen=True, slots=True, eq=False)
class _Certified:
    """A refined point with its bounds: `gradient` is E, `least` s of the module's text."""

    u: DoubleDouble
    r: DoubleDouble
    gradient: float
    least: float
    condition: float
    steps: int
    inside: bool  # whether every free entry is between its breaks


def _refine(s: ScaledProblem, ridge: float, state: _ActiveSet) -> _Certified:
    """Refine the free entries, and bound what is left of the gradient."""
    exact, free = ExactMatrix(s.T), np.flatnonzero(state.free)
    factor = SVD(s.T[:, free], s.mu * ridge) if len(free) else None
    constant = np.zeros(len(s.h))
    constant[free] = state.slope
    u = DoubleDouble.of(state.u)
    r = DoubleDouble.of(s.eps) - exact @ u
    best = np.inf
    kept = (u, r)
    steps = 0
    for steps in range(REFINEMENTS):
        f1 = (DoubleDouble.of(s.eps) - exact @ u - r).hi
        push = DoubleDouble.of(s.mu * ridge) * u + DoubleDouble.of(s.mu * (constant + s.beta))
        f2 = (exact.transposed(r) - push).hi[free]
        size = float(np.linalg.norm(f2)) + s.norm * float(np.linalg.norm(f1))
        if size < best:
            best, kept = size, (u, r)
        if factor is None or not size < np.inf or (steps and size > 0.5 * best and size != best):
            break
        du = np.zeros(len(s.h))
        du[free] = factor.solve(f1, f2)
        u = u + DoubleDouble.of(du)
        r = r + DoubleDouble.of(f1 - s.T @ du)
    u, r = kept
    best = 0.0 if factor is None else best
    return _bounded(s, ridge, state, u, r, best, steps)


def _bounded(
    s: ScaledProblem, ridge: float, state: _ActiveSet, u: DoubleDouble, r: DoubleDouble,
    gradient: float, steps: int,
) -> _Certified:  # fmt: skip
    """Add the rounding of the evaluation to the gradient, and find the least singular value."""
    size, dual = float(np.linalg.norm(u.hi)), float(np.linalg.norm(r.hi))
    parts = s.norm * (s.norm * size + float(np.linalg.norm(s.eps)) + dual)
    parts += s.mu * (ridge * size + (abs(s.beta) + 1.0) * np.sqrt(len(u.hi)))
    doubt = PRODUCT_ERROR * parts
    E = gradient + (doubt if state.free.any() else 0.0)
    force = ExactMatrix(s.T).transposed(r) - DoubleDouble.of(s.mu * ridge) * u
    excess, _ = state.excess((force - DoubleDouble.of(np.full(len(s.h), s.mu * s.beta))).hi, s.mu)
    loose, least, condition = state.free.copy(), np.inf, 1.0
    for _ in range(len(s.h) + 1):
        if loose.any():
            factor = SVD(s.T[:, loose], s.mu * ridge)
            least, condition = factor.least, factor.condition
        needed = 2.0 * s.norm * E / least if least > 0.0 else np.inf
        more = ~state.free & ~loose & (excess > -(needed + doubt))
        if not more.any():
            break
        loose = loose | more
        over = np.maximum(excess[loose & ~state.free], 0.0)
        E = gradient + doubt + float(np.linalg.norm(over))
    low, high = state.limits()
    inside = bool(np.all((u.hi[state.free] > low) & (u.hi[state.free] < high)))
    return _Certified(u, r, E if loose.any() else 0.0, least, condition, steps, inside)


def solve_pieces(problem: Problem) -> Solution:
    """Solve for a regulariser of straight pieces.

    Parameters
    ----------
    problem : Problem
        With the regulariser ``deadzone``, ``rectifier`` or ``saturation``, or another with pieces.

    Returns
    -------
    Solution
        Certificate: duality gap in the units of the objective. Not trusted where the minimum is not
        unique, or double precision cannot tell that it is.

    Raises
    ------
    SolverError
        The search does not end, or T is too small for lambda.

    Examples
    --------
    >>> import numpy as np
    >>> T, eps = np.eye(2), np.array([3.0, 0.4])
    >>> solve_pieces(Problem(T, eps, 1.0, "deadzone", ridge_share=0.0)).u.tolist()
    [2.5, 0.0]
    """
    start = time.perf_counter()
    s, ridge = ScaledProblem.of(problem), problem.ridge_share
    state, steps = _ActiveSet.of(s), 0
    for _ in range(ATTEMPTS):
        steps += _search(s, ridge, state)
        point = _refine(s, ridge, state)
        steps += point.steps
        if point.inside:
            break
        low, high = state.limits()
        free, new = np.flatnonzero(state.free), point.u.hi[state.free]
        state.hold(free[(new <= low) | (new >= high)], (new >= high)[(new <= low) | (new >= high)])
    return _solution(problem, s, point, steps, start)


def _solution(
    problem: Problem, s: ScaledProblem, point: _Certified, steps: int, start: float
) -> Solution:
    u, E, least = point.u.hi, point.gradient, point.least
    peak = float(np.max(np.abs(u)))
    rounding = EPS / 2.0 * peak
    unscale = 2.0 * s.scale * s.scale
    allowed = max(RELATIVE_ERROR * max(peak, SMALLEST_SCALE) - rounding, 0.0)
    known = point.inside and (least > 0.0 or (E == 0.0 and least == np.inf))
    gap = 0.5 * (E / least) ** 2 if known else np.nan
    bound = 0.5 * (allowed * min(least, s.norm) / 4.0) ** 2
    error = (4.0 * E / least / least + rounding) if known else np.inf
    trusted = bool(known and unscale * gap <= unscale * bound)
    pieces, ridge = s.regulariser.pieces, problem.ridge_share
    size = 0.0 if pieces is None else pieces.size
    penalty = float(np.sum(size * np.abs(u) + 0.5 * ridge * u * u + s.beta * u))
    residual = point.r.hi
    inputs = s.transposed(residual) / s.mu - s.beta + (1.0 - ridge) * u
    why = (
        "the minimum is not unique: columns of T at the free entries depend on one another; keep a"
        " ridge term (ridge_share above 0)"
        if not known
        else f"the duality gap {unscale * gap!r} is above {unscale * bound!r}: double precision is"
        " not enough; keep a ridge term (ridge_share above 0), or use fewer channels"
    )
    return Solution(
        problem=problem,
        u=u,
        v=inputs,
        objective=unscale * (0.5 * float(residual @ residual) + s.mu * penalty),
        certificate_kind="duality gap",
        certificate=unscale * gap,
        bound=unscale * bound,
        error_bound=error,
        trusted=trusted,
        condition=point.condition,
        iterations=steps,
        seconds=time.perf_counter() - start,
        reason="" if trusted else why,
    )
