"""A bound on how far the solution moves when the matrix of a problem changes.

With ``F(u) = |T u - eps|^2 / 2 + mu * (sum of the integrals of g^-1 + beta u)`` let u be the
solution for T, and w the solution for ``T' = T + E``. The gradient of F' (that of T') is zero at
w. At u it is ``p = T'^T (T' u - eps) - T^T (T u - eps) = T'^T E u - E^T r``, ``r = eps - T u``,
since the gradient of F is zero at u and the regulariser is the same. Along the line from u to w::

    (T'^T T' + D) (w - u) = -p,   D = mu * diag(mean of (g^-1)' between u_n and w_n)

Suppose ``D_n >= 1 / c_n`` with c_n > 0. With ``A = T' D^(-1/2)``::

    w - u = D^(-1/2) ((A^T A + 1)^-1 D^(-1/2) E^T r - (A^T A + 1)^-1 A^T E u)

The norm of ``(A^T A + 1)^-1`` is at most 1, and that of ``(A^T A + 1)^-1 A^T`` at most
``max s / (s^2 + 1) = 1/2``. So every channel obeys::

    |w_n - u_n| <= sqrt(c_n) * (|sqrt(c) E^T r| + |E u| / 2)                              (1)

For linear amplifiers ``c = 1/lam``: ``|w_n - u_n| <= |E^T r| / lam + |E u| / (2 sqrt(lam))``.

For the others c depends on w: ``(g^-1)' = 1/g'``, and g' is at most ``S(u_n) + d`` within d of
u_n (`Regulariser.slope_bound`) and at most `steepest` anywhere, so
``c_n(d) = min(S(u_n) + d, steepest) / mu`` holds if every w_n is within d of u_n. Take a d for
which the right-hand side of (1) with c(d) is at most d. Where the domain of g^-1 goes beyond these
intervals, continue g^-1 from their ends by straight lines with the slopes there, which obey the
bound too. For the function so changed (1) holds without a condition, so its minimiser is inside
the intervals, where the function is F'. F' is strictly convex, so that minimiser is w, and (1)
holds for w.
"""

from __future__ import annotations

import math

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS

ROUNDING = 2.0 * EPS  # of the residual, for each term of its sums
DOUBLINGS = 60  # of the assumed distance d
SHRINKS = 60  # of d afterwards; each keeps (1) true


def change_bound(solution: Solution, changed: Floats) -> float:
    """Return a proven bound on the largest change of a channel when T becomes `changed` (M, N).

    The bound holds between the exact solutions; the error of `solution` is included. It is infinite
    at lambda = 0, if the solution is not trusted, or if no distance d exists (see the head of this
    file).

    Examples
    --------
    >>> from taction.verification.reference.solve import solve
    >>> T, eps = np.array([[1.0, 0.02], [0.01, 1.0]]), np.array([1.0, 0.0])
    >>> before, after = (solve(Problem(A, eps, 0.5)) for A in (T, np.eye(2)))
    >>> float(np.abs(after.u - before.u).max()) < change_bound(before, np.eye(2)) < 0.03
    True
    """
    problem = solution.problem
    if not (isinstance(problem, Problem) and solution.trusted and problem.lam > 0.0):
        return math.inf
    kind, size = REGULARISERS[problem.regulariser], math.sqrt(len(solution.u))
    E, mu = changed - problem.T, kind.weight * problem.lam
    off = solution.error_bound * size  # of u, in the Euclidean norm
    norm, whole = float(np.linalg.norm(E)), float(np.linalg.norm(problem.T))
    moved = float(np.linalg.norm(E @ solution.u)) + norm * off
    rounding = (
        ROUNDING
        * max(E.shape)
        * (whole * float(np.linalg.norm(solution.u)) + float(np.linalg.norm(problem.eps)))
    )
    residual = problem.eps - problem.T @ solution.u
    pull = np.abs(E.T @ residual) + norm * (whole * off + rounding)
    slopes = kind.slope_bound(solution.u) + solution.error_bound

    def bound(distance: float) -> float:
        c = np.minimum(slopes + distance, kind.steepest) / mu
        return float(np.sqrt(c.max()) * (np.linalg.norm(np.sqrt(c) * pull) + moved / 2.0))

    least = bound(0.0)
    valid = (d for d in least * 2.0 ** np.arange(DOUBLINGS) if bound(d) <= d)
    distance = float(next(valid, math.inf))
    if math.isinf(distance):
        return math.inf
    for _ in range(SHRINKS):
        distance = bound(distance)  # bound increases with d, so bound(bound(d)) <= bound(d)
    return distance + solution.error_bound
