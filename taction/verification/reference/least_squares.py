"""Solver for linear amplifiers and for regularisers of straight pieces: one least squares problem.

Each entry of u is at a break (a bound, or 0 where ``|u|`` has its corner) or free between two. The
search is that of Lawson and Hanson (Solving Least Squares Problems, chapter 23): the entry whose
condition is violated most is freed, and a step to the new minimum ends at the first break. The
objective falls with each step, so no set comes back.

It minimises ``1/2 |T u - eps|^2 + mu sum(size |u| + ridge u^2 / 2 + beta u)`` within bounds of u;
of a linear amplifier only the ridge term is there, and mu may be 0. The entries between two breaks
are free, and solve a linear problem by the SVD of T, refined with residuals of more digits.
The unknowns are u and the residual ``r = eps - T u`` together (Bjorck, BIT 7, 1967), so refinement
contracts with the condition number and not with its square.

With ``f1 = eps - T u - r``, f2 the gradient ``T^T r - mu (...)`` at the free entries and s the
least singular value of ``[T_F; sqrt(mu ridge) 1]``, the error of a linear problem is at most
``|f1| / s + |f2| / s^2``. Where entries are at breaks, strong convexity and the distances of their
conditions from the limits bound it by four times that; entries without such a distance count as
free for s, and what exceeds their limits counts as gradient.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import EPS, Bools, Floats, Ints
from taction.system.errors import SolverError
from taction.verification.reference.problem import (
    ENOUGH,
    RELATIVE_ERROR,
    SMALLEST_SCALE,
    Extended,
    Problem,
    ScaledProblem,
    Solution,
    norm,
)

STEPS_PER_ENTRY = 20  # of the search, before it gives up
VIOLATED = 64.0 * EPS  # of the terms of a condition: a smaller violation is rounding
FAR = 1e6  # length of a step along which the objective only falls


class SVD:
    """Singular values `sigma` (N,) of T, 0 where rounding hides them; mu may be 0.

    `least` is a lower bound on the least singular value of the stacked matrix (0 if it is
    rank-deficient), `condition` the condition number of the stacked matrix.

    SolverError: the decomposition does not converge.
    """

    def __init__(self, T: Floats, mu: float) -> None:
        rows, N = T.shape
        whole = np.vstack([T, np.zeros((max(N - rows, 0), N))])  # so that V has N columns
        try:
            U, sigma, self._Vt = np.linalg.svd(whole, full_matrices=False)
        except np.linalg.LinAlgError as error:
            raise SolverError(f"singular value decomposition of T: {error}") from error
        self._U = U[:rows]
        doubt = 4.0 * max(T.shape) * EPS * sigma[0]
        self.sigma = np.where(sigma > doubt, sigma, 0.0)
        square = self.sigma**2 + mu
        self._gain = np.divide(1.0, square, out=np.zeros(N), where=square > 0.0)
        last = float(sigma[-1]) if rows >= N else 0.0
        self.least = float(np.hypot(max(last - doubt, 0.0), np.sqrt(mu)))
        largest, smallest = (float(np.hypot(x, np.sqrt(mu))) for x in (sigma[0], last))
        self.condition = largest / smallest if smallest > 0.0 else float("inf")

    def solve(self, f1: Floats, f2: Floats) -> Floats:
        """Return y (N,) for f1 (M,), f2 (N,); if mu = 0, without components in T's null space."""
        y = self._gain * (self.sigma * (f1 @ self._U) + self._Vt @ f2)
        return np.asarray(y @ self._Vt)

    def along_null(self, f2: Floats) -> Floats:
        """Return the part of f2 that T does not see, (N,)."""
        hidden = self._Vt[self.sigma == 0.0]
        return np.asarray((hidden @ f2) @ hidden)


@dataclass(slots=True)
class ActiveSet:
    """Where each entry of u is: at a break, or free in the interval to the right of a break."""

    breaks: Floats  # (k,): increasing
    # (k + 1,): of phi without its ridge term, in the intervals from left to right; infinite outside
    # bounds.
    slopes: Floats
    place: Ints  # (N,): number of the break, or of the interval
    free: Bools  # (N,): whether it is the number of an interval
    u: Floats  # (N,): values

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

    SolverError: the search does not end.
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


REFINEMENTS = 20
ATTEMPTS = 4  # searches: refinement may show that an entry belongs to a break


@dataclass(frozen=True, slots=True, eq=False)
class _Answer:
    """u and r with a bound on the error of each entry, infinite where u is not unique."""

    u: Extended
    r: Extended
    error: float
    least: float
    condition: float
    steps: int


def _floor(s: ScaledProblem) -> float:
    """Return the least value of what errors of u are compared with."""
    if s.regulariser.pieces is not None:
        return SMALLEST_SCALE
    return SMALLEST_SCALE * float(np.linalg.norm(s.eps)) / s.norm if s.norm > 0.0 else 0.0


def _refine(s: ScaledProblem, mu: float, state: ActiveSet, factor: SVD) -> _Answer:
    """Solve for the free entries; refine until the error is small, or stops shrinking."""
    free, load, least = state.free, np.zeros(len(s.h)), factor.least
    load[free] = s.mu * (state.slope + s.beta)
    start = np.where(free, 0.0, state.u)
    start[free] = factor.solve(s.eps - s.T @ start, -load[free])
    u, r = start.astype(np.longdouble), (s.eps - s.T @ start).astype(np.longdouble)
    before, floor = np.inf, _floor(s)
    for step in range(REFINEMENTS):
        f1, f2, off1, off2 = s.residuals(u, r, mu * u, load)
        rounding = off1 * (least or s.norm) + norm(off2)
        left = norm(f1) * (least or s.norm) + norm(f2[free])
        error = (left * (1.0 + 4.0 * EPS) + rounding) / least / least if least > 0.0 else np.inf
        if left < before or step == 0:
            best = _Answer(u, r, error, least, factor.condition, step)
        enough = error <= ENOUGH * max(float(np.abs(u).max()), floor) or left <= rounding
        if enough or not left <= 0.5 * before:
            break
        du = np.zeros(len(s.h))
        du[free] = factor.solve(f1, f2[free])
        u, r = u + du, r + (f1 - s.T @ du)
        before = left
    return best


def _of_pieces(s: ScaledProblem, mu: float) -> _Answer:
    """Search the active set and refine; an entry that refinement takes over a break is held."""
    state, steps = ActiveSet.of(s), 0
    for _ in range(ATTEMPTS):
        steps += search(s, mu / s.mu, state)
        if not state.free.any():
            u = state.u.astype(np.longdouble)
            found = _Answer(u, s.eps - s.T.astype(np.longdouble) @ u, 0.0, np.inf, 1.0, 0)
            break
        found = _refine(s, mu, state, SVD(s.T[:, state.free], mu))
        low, high = state.limits()
        new = found.u[state.free].astype(np.float64)
        outside = (new <= low) | (new >= high)
        if not outside.any():
            break
        state.hold(np.flatnonzero(state.free)[outside], (new >= high)[outside])
    else:
        found = replace(found, error=np.inf)
    return replace(_certified(s, mu, state, found), steps=steps + found.steps)


def _certified(s: ScaledProblem, mu: float, state: ActiveSet, found: _Answer) -> _Answer:
    """Bound the error where entries are held; those near their limits count as free."""
    gradient = found.error * found.least**2 if state.free.any() else 0.0
    loads = mu * found.u, np.full(len(s.h), s.mu * s.beta)
    _, force, _, rounding = s.residuals(found.u, found.r, *loads)
    excess, _ = state.excess(force, s.mu)
    loose, least, condition, E = state.free.copy(), found.least, found.condition, gradient
    doubt = 4.0 * EPS * (np.abs(force) + s.mu * (1.0 + abs(s.beta))) + rounding
    for _ in range(len(s.h) + 1):
        needed = 2.0 * s.norm * E / least if least > 0.0 else np.inf
        more = ~state.free & ~loose & (excess > -(needed + doubt))
        if not more.any():
            break
        loose |= more
        factor = SVD(s.T[:, loose], mu)
        least, condition = factor.least, factor.condition
        over = (excess + doubt)[loose & ~state.free]
        E = gradient + float(np.linalg.norm(np.maximum(over, 0.0)))
    error = 4.0 * E / least / least if least > 0.0 else np.inf
    return replace(found, error=error, least=least, condition=condition)


def solve_least_squares(problem: Problem, strains: Iterable[Floats]) -> list[Solution]:
    """Solve a problem of a linear amplifier or of straight pieces, for each of `strains` (M,).

    A linear problem factorises T once.

    SolverError: the search does not end, a decomposition does not converge, or T is too small for
      lambda.
    """
    start = time.perf_counter()
    base = ScaledProblem.of(problem)
    pieces, mu = base.regulariser.pieces, base.mu * problem.ridge_share
    factor, solutions = None if pieces else SVD(base.T, mu), []
    for eps in strains:
        each, s = replace(problem, eps=eps), base.with_strain(eps)
        found = _refine(s, mu, ActiveSet.of(s), factor) if factor else _of_pieces(s, mu)
        solutions.append(_solution(each, s, found, start))
        start = time.perf_counter()
    return solutions


def _solution(problem: Problem, s: ScaledProblem, found: _Answer, start: float) -> Solution:
    """Return the answer with its certificate, and the reason where it is not trusted."""
    u, residual = found.u.astype(np.float64), found.r.astype(np.float64)
    pieces = s.regulariser.pieces
    peak, size = float(np.max(np.abs(u))), float(np.linalg.norm(s.eps))
    rounding = EPS / 2.0 * peak  # of u, and of mu times the share of the ridge term
    if problem.ridge_share not in {0.0, 1.0}:
        rounding += 2.0 * EPS * float(np.linalg.norm(u))
    error, allowed = found.error + rounding, RELATIVE_ERROR * max(peak, _floor(s))
    trusted = bool(error <= allowed)
    unit = s.norm * (s.norm * float(np.linalg.norm(u)) + size) or 1.0
    weight = min(found.least, s.norm) ** 2 / unit
    ridge, slope = problem.ridge_share, 0.0 if pieces is None else pieces.size
    penalty = float(np.sum(slope * np.abs(u) + 0.5 * ridge * u * u + s.beta * u))
    v = None if pieces is None else residual @ s.T / s.mu - s.beta + (1.0 - ridge) * u
    return Solution(
        problem=problem,
        u=u,
        v=v,
        objective=2.0 * s.scale**2 * (0.5 * float(residual @ residual) + s.mu * penalty),
        certificate_kind="relative residual",
        certificate=found.error * weight,
        bound=max(allowed - rounding, 0.0) * weight,
        error_bound=error,
        trusted=trusted,
        condition=found.condition,
        iterations=found.steps,
        seconds=time.perf_counter() - start,
        reason="" if trusted else _reason(problem, found),
    )


def _reason(problem: Problem, found: _Answer) -> str:
    if problem.regulariser != "linear":
        return (
            "the minimum is not unique, or double precision does not tell: columns of T at the free"
            " entries depend on one another; keep a ridge term (ridge_share above 0)"
        )
    known = f"its condition number is {found.condition:.3g}"
    if problem.lam == 0.0:
        return (
            f"T is singular to double precision: {known}; remove rows or columns that say the same,"
            " or use a lambda above 0, as ridge regression has"
        )
    return (
        f"double precision is not enough for lambda = {problem.lam!r}: the condition number is"
        f" {found.condition:.3g}; use a larger lambda or fewer channels"
    )
