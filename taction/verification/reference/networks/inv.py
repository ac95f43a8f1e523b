"""The ideal network of topology ``inv``: ``T u = eps`` for a square T.

LU with partial pivoting (`numpy.linalg.solve`; the import of `scipy.linalg` takes longer than some
factorisations), refined with residuals in 106 bits. With the residual ``r = eps - T u``
and the least singular value s of T, the error of u is at most ``|r| / s``.
"""

from __future__ import annotations

import time

import numpy as np

from taction.system.array_types import EPS, Floats
from taction.system.errors import SolverError
from taction.verification.reference.doubledouble import PRODUCT_ERROR, DoubleDouble, ExactMatrix
from taction.verification.reference.dynamics import AtOnce
from taction.verification.reference.problem import (
    RELATIVE_ERROR,
    SMALLEST_SCALE,
    Problem,
    Solution,
)

MAX_REFINEMENTS = 20
LARGEST_CONDITION = 1e13  # with more, double precision does not tell whether T is singular


def solve_square(problem: Problem) -> Solution:
    """Solve ``T u = eps``; lambda of `problem` is 0, and T is square.

    Raises
    ------
    SolverError
        T is not square, or its singular values cannot be computed.

    Examples
    --------
    >>> found = solve_square(Problem([[2.0, 1.0], [1.0, 3.0]], [3.0, 4.0], 0.0))
    >>> found.u.tolist(), found.trusted
    ([1.0, 1.0], True)
    """
    start, N = time.perf_counter(), problem.T.shape[1]
    if problem.T.shape != (N, N):
        raise SolverError(f"T is {problem.T.shape[0]} by {N}; a square matrix is needed")
    scale = 2.0 ** round(float(np.log2(np.abs(problem.T).max() or 1.0)))
    T, eps = problem.T / scale, problem.eps / scale
    try:
        sigma = np.linalg.svd(T, compute_uv=False)
    except np.linalg.LinAlgError as error:
        raise SolverError(f"singular value decomposition of T: {error}") from error
    least = float(sigma[-1]) - 4.0 * N * EPS * float(sigma[0])
    condition = float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else float("inf")
    if not condition < LARGEST_CONDITION:
        return _solution(problem, np.zeros(N), (np.inf, 1.0, 0.0), condition, 0, start)
    exact, norm, size = ExactMatrix(T), float(np.linalg.norm(T)), float(np.linalg.norm(eps))
    u = _solved(T, eps)
    residual, rounding = _residual(exact, eps, u, norm, size)
    steps = 0
    while steps < MAX_REFINEMENTS and np.linalg.norm(residual) > rounding:
        trial = u + _solved(T, residual)
        found, bound = _residual(exact, eps, trial, norm, size)
        steps += 1
        if not np.linalg.norm(found) < 0.5 * np.linalg.norm(residual):
            break
        u, residual, rounding = trial, found, bound
    left = float(np.linalg.norm(residual)) + rounding
    unit = norm * float(np.linalg.norm(u.hi)) + size
    return _solution(problem, u.hi, (left, unit, least), condition, steps, start)


def _solved(T: Floats, load: Floats) -> DoubleDouble:
    return DoubleDouble.of(np.asarray(np.linalg.solve(T, load), dtype=np.float64))


def _residual(
    exact: ExactMatrix, eps: Floats, u: DoubleDouble, norm: float, size: float
) -> tuple[Floats, float]:
    """Return ``eps - T u`` and a bound on the rounding error of its norm."""
    residual: Floats = (DoubleDouble.of(eps) - exact @ u).hi
    return residual, PRODUCT_ERROR * (norm * float(np.linalg.norm(u.hi)) + size)


def _solution(
    problem: Problem,
    u: Floats,
    proof: tuple[float, float, float],
    condition: float,
    steps: int,
    start: float,
) -> Solution:
    """Return the solution with its certificate; `proof`: residual, its unit, least sigma."""
    left, unit, least = proof
    peak = float(np.max(np.abs(u)))
    rounding = EPS / 2.0 * peak
    error = left / least + rounding if least > 0.0 else np.inf
    size, norm = float(np.linalg.norm(problem.eps)), float(np.linalg.norm(problem.T))
    allowed = RELATIVE_ERROR * max(peak, SMALLEST_SCALE * size / norm)
    trusted = bool(error <= allowed)
    residual = problem.eps - problem.T @ u
    return Solution(
        problem=problem,
        u=u,
        v=None,
        objective=float(residual @ residual),
        certificate_kind="relative residual",
        certificate=left / unit if unit > 0.0 else 0.0,
        bound=max(allowed - rounding, 0.0) * max(least, 0.0) / unit if unit > 0.0 else 0.0,
        error_bound=error,
        trusted=trusted,
        condition=condition,
        iterations=steps,
        seconds=time.perf_counter() - start,
        reason=""
        if trusted
        else (
            f"T is singular to double precision: its condition number is {condition:.3g}; remove"
            " rows and columns that say the same, or use topology 'ridge'"
        ),
    )


NETWORK = AtOnce(solve_square)
