"""Answers to the reference problem from arbitrary precision, and random problems to ask for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mpmath
import numpy as np

from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.solve import solve

Scalar = Callable[[mpmath.mpf], mpmath.mpf]

SMOOTH: dict[str, tuple[Scalar, Scalar]] = {
    "linear": (lambda v: v, lambda v: mpmath.mpf(1)),
    "exponential": (mpmath.exp, mpmath.exp),
    "sinh": (mpmath.sinh, mpmath.cosh),
    "softplus": (lambda v: mpmath.log1p(mpmath.exp(v)), lambda v: 1 / (1 + mpmath.exp(-v))),
    "tanh": (mpmath.tanh, lambda v: mpmath.sech(v) ** 2),
}
AMPLIFIERS = {
    **SMOOTH,
    "deadzone": (lambda v: v - min(max(v, -1), 1), lambda v: mpmath.mpf(abs(v) > 1)),
    "rectifier": (lambda v: max(v, 0), lambda v: mpmath.mpf(v > 0)),
    "saturation": (lambda v: min(max(v, -1), 1), lambda v: mpmath.mpf(abs(v) < 1)),
}


def exact_solution(
    problem: Problem, start: np.ndarray, digits: int = 60
) -> tuple[list[mpmath.mpf], list[mpmath.mpf]] | None:
    """Newton's method on ``T^T (T u - eps) + mu (v - taken u + beta) = 0`` in v; None: no end.

    `taken` is the share of the ridge term that is taken away.

    The problem is convex, so a root found from any start is the solution.
    """
    with mpmath.workdps(digits):
        g, slope = AMPLIFIERS[problem.regulariser]
        mu = mpmath.mpf(problem.lam) / (1 if problem.regulariser == "linear" else 2)
        T, eps = mpmath.matrix(problem.T.tolist()), mpmath.matrix(problem.eps.tolist())
        channels, taken = problem.T.shape[1], 1 - mpmath.mpf(problem.ridge_share)
        gram, load = T.T * T, T.T * eps
        v = mpmath.matrix(start.tolist())
        shift = mpmath.ones(channels, 1) * int(problem.bias)
        for _ in range(60):
            force = gram * v.apply(g) - load + mu * (v - taken * v.apply(g) + shift)
            slopes = mpmath.diag([slope(x) for x in v])
            jacobian = gram * slopes + mu * (mpmath.eye(channels) - taken * slopes)
            step = mpmath.lu_solve(jacobian, -force)
            v += step
            size = max(1, *(abs(x) for x in v))
            if max(abs(x) for x in step) < mpmath.mpf(10) ** (-digits // 2 - 5) * size:
                return [g(x) for x in v], list(v)
    return None


def exact(problem: Problem) -> list[mpmath.mpf] | None:
    """Return u to 60 digits, from the solver's own answer; None if there is none near it."""
    answer = solve(problem)
    found = exact_solution(problem, answer.u if answer.v is None else answer.v)
    return None if found is None else found[0]


def optimum(T: np.ndarray, eps: np.ndarray, lam: float, kind: str = "linear") -> np.ndarray:
    """Return u, dimensionless, right to the last digit; with the bias that is usual for `kind`."""
    found = exact(Problem(T, eps, lam, kind, bias=kind == "exponential"))
    assert found is not None
    return np.array([float(value) for value in found])


def error_of(solution: Solution) -> float:
    """Return ``max |u - u*|``; infinite if arbitrary precision finds no solution near it."""
    assert isinstance(solution.problem, Problem)
    found = exact(solution.problem)
    if found is None:
        return float("inf")
    return float(max(abs(a - b) for a, b in zip(found, solution.u.tolist(), strict=True)))


def random_problems(seed: int, count: int) -> Iterator[Problem]:
    """Problems over all smooth regularisers, |T| from 1e-13 to 1e3 and lam over eighteen decades.

    T is dense, banded like a kernel, sparse, or of rank one.
    """
    rng = np.random.default_rng(seed)
    for number in range(count):
        rows, channels = (int(n) for n in rng.integers(1, 9, 2))
        regulariser = tuple(SMOOTH)[number % len(SMOOTH)]
        scale = 10.0 ** rng.uniform(-13, 3)
        T = scale * _matrix(rng, rows, channels)
        u = np.exp(2.0 * rng.standard_normal(channels)) * 10.0 ** rng.uniform(-2, 4)
        noise = scale * 10.0 ** rng.uniform(-8, 2) * (rng.random() < 0.8)
        eps = rng.choice([-1, 0, 1, 1]) * (T @ u) + noise * rng.standard_normal(rows)
        lam = 10.0 ** rng.uniform(-12, 6) * rng.choice([1.0, scale, scale**2])
        linear = regulariser == "linear"
        if linear and rng.random() < 0.2:
            lam = 0.0
        yield Problem(T, eps, lam, regulariser, bias=not linear and bool(rng.random() < 0.5))


def _matrix(rng: np.random.Generator, rows: int, channels: int) -> np.ndarray:
    dense = rng.standard_normal((rows, channels))
    kind = rng.integers(4)
    if kind == 0:
        return dense
    if kind == 1:
        return kernel(np.arange(rows), np.arange(channels), float(np.exp(rng.uniform(-1, 2))))
    if kind == 2:
        return dense * (rng.random((rows, channels)) < 0.4)
    return np.outer(rng.standard_normal(rows), rng.standard_normal(channels))


def kernel(sensors: np.ndarray, channels: np.ndarray, depth: float) -> np.ndarray:
    """Kernel (19) for unit modulus, shape (sensors, channels)."""
    d2 = (sensors[:, None] - channels) ** 2
    return np.asarray(1.5 / np.pi * (depth**2 - d2) / (depth**2 + d2) ** 2)


@dataclass(frozen=True)
class Claims:
    """How many were asked, which had no answer, which claims were false, and the worst error."""

    asked: int
    inconclusive: tuple[Problem, ...]
    false: tuple[Problem, ...]
    worst: float


def count_claims(problems: Iterator[Problem]) -> Claims:
    """Solve every problem and check every trusted answer against arbitrary precision."""
    asked, worst = 0, 0.0
    inconclusive, false = [], []
    for problem in problems:
        asked += 1
        solution = solve(problem)
        if not solution.trusted:
            inconclusive.append(problem)
            continue
        error, peak = error_of(solution), float(np.max(np.abs(solution.u)))
        if not error <= solution.error_bound:
            false.append(problem)
        if peak > 1e-12:
            worst = max(worst, error / peak)
    return Claims(asked, tuple(inconclusive), tuple(false), worst)
