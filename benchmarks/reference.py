"""The reference solver beside cvxpy with Clarabel and SciPy's trust-region method, and at size.

Entropy regulariser, kernel (19) at depth 1 over [-3, 3], half a cylinder load with noise. cvxpy's
problem is compiled before the clock starts. SciPy minimises over v = log u with exact gradient and
Hessian.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.measuring import Extent, Figure, Result, Table, in_turns, ratios
from taction.system.array_types import Floats
from taction.verification.evidence.paper.toeplitz import ToeplitzMatrix, solve_toeplitz_problem
from taction.verification.reference.problem import Problem, ToeplitzProblem
from taction.verification.reference.solve import solve
from tests.support.oracle import count_claims, kernel, random_problems

OURS, CLARABEL, TRUST = "ours", "cvxpy with Clarabel", "SciPy's trust-exact"
SIZES = {Extent.TINY: (3,), Extent.QUICK: (7, 50), Extent.FULL: (7, 25, 50, 100, 200)}
LAMBDAS = (10.0, 0.1, 1e-4, 1e-12)
ROUNDS = {Extent.TINY: 1, Extent.QUICK: 3, Extent.FULL: 7}
LARGEST_TRUST = 100  # channels
PROBLEMS, SEED = 1000, 1993
CHANNELS, SPACING = 1_000_000, 0.25
TOEPLITZ = {"linear": (10.0, 0.01, 1e-4), "exponential": (10.0, 0.1, 0.01)}


def tactile(channels: int, lam: float) -> Problem:
    """Return the paper's problem."""
    y = np.linspace(-3.0, 3.0, channels)
    T = kernel(y, y, 1.0)
    stress = np.sqrt(np.maximum(1.0 - y * y, 0.0))
    noise = 0.1 * np.random.default_rng(0).standard_normal(channels)
    return Problem(T, T @ stress + noise, lam, "exponential", bias=True)


def clarabel(problem: Problem) -> Callable[[], Any]:
    """Compile with cvxpy."""
    cp: Any = import_module("cvxpy")
    u = cp.Variable(problem.T.shape[1])
    loss = cp.sum_squares(problem.T @ u - problem.eps)
    task = cp.Problem(cp.Minimize(loss - problem.lam * cp.sum(cp.entr(u))))
    task.get_problem_data(cp.CLARABEL)

    def run() -> Floats:
        task.solve(solver=cp.CLARABEL)
        return np.asarray(u.value)

    return run


def trust(problem: Problem) -> Callable[[], Any]:
    """Set up SciPy's minimiser in v."""
    minimize: Any = import_module("scipy.optimize").minimize
    T, eps, lam = problem.T, problem.eps, problem.lam
    gram = 2.0 * T.T @ T

    def value(v: Floats) -> float:
        u = np.exp(v)
        miss = T @ u - eps
        return float(miss @ miss + lam * u @ v)

    def gradient(v: Floats) -> Floats:
        u = np.exp(v)
        return np.asarray(u * (2.0 * T.T @ (T @ u - eps) + lam * (v + 1.0)))

    def hessian(v: Floats) -> Floats:
        u = np.exp(v)
        return np.asarray(gram * np.outer(u, u) + np.diag(gradient(v) + lam * u))

    options = {"method": "trust-exact", "options": {"maxiter": 1000, "gtol": 1e-8}}

    def run() -> Floats:
        with np.errstate(all="ignore"):
            found = minimize(value, np.zeros(T.shape[1]), jac=gradient, hess=hessian, **options)
        return np.asarray(np.exp(found.x))

    return run


def measure(extent: Extent) -> Result:
    """Compare the solvers; in full also a million channels, and a thousand random problems."""
    rows = []
    beside: dict[str, list[float]] = {CLARABEL: [], TRUST: []}
    for channels in SIZES[extent]:
        for lam in LAMBDAS:
            problem = tactile(channels, lam)
            jobs: dict[str, Callable[[], Any]] = {
                OURS: partial(answer, problem),
                CLARABEL: clarabel(problem),
            }
            if channels <= LARGEST_TRUST:
                jobs[TRUST] = trust(problem)
            found = in_turns({who: seconds(job) for who, job in jobs.items()}, ROUNDS[extent])
            u, cells = jobs[OURS](), []
            for who in [who for who in beside if who in jobs]:
                times = ratios(found[who], found[OURS])
                beside[who] += times
                error = np.abs(jobs[who]() - u).max() / u.max()
                cells.append(f"{statistics.median(times):.1f} ({error:.0e})")
            ours = 1e3 * statistics.median(found[OURS])
            rows.append((f"{channels}", f"{lam:g}", f"{ours:.2f}", *cells))
    sizes = f"{SIZES[extent][0]} to {SIZES[extent][-1]} channels"
    figures = [
        Figure(f"{who}, {sizes}", "the reference solver", times) for who, times in beside.items()
    ]
    columns = ("channels", "lambda", "ours, ms", *(f"{who}, times (error)" for who in beside))
    tables = [Table("Reference solver", columns, rows)]
    return Result(figures, tables + ([claims(), large()] if extent is Extent.FULL else []))


def answer(problem: Problem) -> Floats:
    """Return u."""
    return solve(problem).u


def seconds(job: Callable[[], Any]) -> Callable[[], float]:
    """Return a function that runs `job` and returns its processor time, s."""

    def timed() -> float:
        begun = time.process_time()
        job()
        return time.process_time() - begun

    return timed


def claims() -> Table:
    """Count wrong answers that the solver calls good, among random problems."""
    found = count_claims(random_problems(SEED, PROBLEMS))
    row = (
        f"{found.asked}",
        f"{len(found.inconclusive)}",
        f"{len(found.false)}",
        f"{found.worst:.1e}",
    )
    columns = ("random problems", "inconclusive", "false claims", "worst error that was claimed")
    return Table("Answers that the reference solver certifies", columns, [row])


def large() -> Table:
    """Solve Toeplitz problems of a million channels."""
    y = SPACING * np.arange(CHANNELS)
    column = 1.5 / np.pi * (1.0 - y * y) / (1.0 + y * y) ** 2
    load = np.maximum(0.0, np.sin(y / 7.3) + 0.5 * np.sin(y / 3.1 + 1.0) - 0.5)
    noise = 0.1 * np.random.default_rng(0).standard_normal(CHANNELS)
    eps = ToeplitzMatrix(column, column).product(load) + noise
    rows = []
    for regulariser, lams in TOEPLITZ.items():
        for lam in lams:
            answer = solve_toeplitz_problem(ToeplitzProblem(column, column, eps, lam, regulariser))
            bound = f"{answer.error_bound / float(np.abs(answer.u).max()):.0e}"
            cells = (f"{answer.seconds:.2f}", f"{answer.iterations}")
            rows.append((regulariser, f"{lam:g}", *cells, bound if answer.trusted else "none"))
    columns = ("regulariser", "lambda", "s", "steps", "error bound over the peak")
    return Table(f"Toeplitz problems of {CHANNELS} channels", columns, rows)
