"""Speed of the reference solver against cvxpy with Clarabel and SciPy's trust-region methods.

Run from the checkout: ``OMP_NUM_THREADS=1 python benchmarks/reference.py [LARGEST_N [LEAST_N]]``.
Entropy regulariser, kernel (19) at depth 1 over [-3, 3], half a cylinder load with noise. Every
solver is run several times in turn with the others; medians of the processor time are printed (one
thread, so on an idle machine they are wall times), each with its own error in u relative to the
largest entry. cvxpy's problem is compiled before the clock starts. SciPy minimises over v = log u
with exact gradient and Hessian.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT)]

from tests.support.oracle import kernel  # noqa: E402 - after the path
from verification.reference import Problem, solve  # noqa: E402 - after the path

SIZES = (7, 25, 50, 100, 200, 500, 1000, 2000)
LAMBDAS = (10.0, 1.0, 0.1, 0.01, 1e-4, 1e-8, 1e-12)
LARGEST = {"clarabel": 200, "trust-exact": 100, "trust-constr": 100}
PATIENCE = 2.0
"""A solver that takes longer than this, s, is run once."""

Solver = Callable[[], np.ndarray]


def tactile(channels: int, lam: float) -> Problem:
    """Return the paper's problem."""
    y = np.linspace(-3.0, 3.0, channels)
    T = kernel(y, y, 1.0)
    stress = np.sqrt(np.maximum(1.0 - y * y, 0.0))
    noise = 0.1 * np.random.default_rng(0).standard_normal(channels)
    return Problem(T, T @ stress + noise, lam, "exponential", bias=True)


def clarabel(problem: Problem) -> Solver:
    """Compile with cvxpy."""
    cp: Any = import_module("cvxpy")
    u = cp.Variable(problem.T.shape[1])
    loss = cp.sum_squares(problem.T @ u - problem.eps)
    task = cp.Problem(cp.Minimize(loss - problem.lam * cp.sum(cp.entr(u))))
    task.get_problem_data(cp.CLARABEL)

    def run() -> np.ndarray:
        task.solve(solver=cp.CLARABEL)
        return np.asarray(u.value)

    return run


def trust(problem: Problem, method: str) -> Solver:
    """Set up SciPy's minimiser in v."""
    minimize: Any = import_module("scipy.optimize").minimize
    T, eps, lam = problem.T, problem.eps, problem.lam
    gram = 2.0 * T.T @ T

    def value(v: np.ndarray) -> float:
        u = np.exp(v)
        miss = T @ u - eps
        return float(miss @ miss + lam * u @ v)

    def gradient(v: np.ndarray) -> np.ndarray:
        u = np.exp(v)
        return np.asarray(u * (2.0 * T.T @ (T @ u - eps) + lam * (v + 1.0)))

    def hessian(v: np.ndarray) -> np.ndarray:
        u = np.exp(v)
        return np.asarray(gram * np.outer(u, u) + np.diag(gradient(v) + lam * u))

    options = {"maxiter": 1000, "gtol": 1e-8}

    def run() -> np.ndarray:
        start = np.zeros(T.shape[1])
        with np.errstate(all="ignore"):
            found = minimize(
                value, start, jac=gradient, hess=hessian, method=method, options=options
            )
        return np.asarray(np.exp(found.x))

    return run


def timed(solvers: dict[str, Solver], repeats: int = 7) -> dict[str, tuple[float, np.ndarray]]:
    """Return the median time, s, and the last answer of each, run in turn."""
    times: dict[str, list[float]] = {name: [] for name in solvers}
    answers: dict[str, np.ndarray] = {}
    for _ in range(repeats):
        for name, run in solvers.items():
            if times[name] and times[name][0] > PATIENCE:
                continue
            start = time.process_time()
            answers[name] = run()
            times[name].append(time.process_time() - start)
    return {name: (statistics.median(times[name]), answers[name]) for name in solvers}


def row(channels: int, lam: float) -> str:
    """Return a line of the table."""
    problem = tactile(channels, lam)
    certified = solve(problem)
    solvers: dict[str, Solver] = {"ours": lambda: solve(problem).u}
    if channels <= LARGEST["clarabel"]:
        solvers["clarabel"] = clarabel(problem)
    for method in ("trust-exact", "trust-constr"):
        if channels <= LARGEST[method]:
            solvers[method] = trust(problem, method)
    results = timed(solvers)
    ours, peak = results["ours"][0], float(np.max(certified.u))
    claim = certified.error_bound / peak if certified.trusted else float("nan")
    cells = [f"{channels:5d} {lam:8.0e} {1e3 * ours:10.2f} {claim:8.0e} {certified.iterations:5d}"]
    for name in LARGEST:
        if name in results:
            seconds, u = results[name]
            error = float(np.max(np.abs(u - certified.u))) / peak
            cells.append(f"{1e3 * seconds:10.1f} {error:8.0e} {seconds / ours:6.1f}x")
    return " | ".join(cells)


def main(largest: int = SIZES[-1], least: int = 0) -> None:
    """Print the table for the sizes from least to largest."""
    heads = [f"{'N':>5} {'lam':>8} {'ours, ms':>10} {'bound':>8} {'steps':>5}"]
    heads += [f"{name + ', ms':>10.10} {'error':>8} {'ratio':>7}" for name in LARGEST]
    print(" | ".join(heads))
    for channels in SIZES:
        for lam in LAMBDAS:
            if least <= channels <= largest:
                print(row(channels, lam), flush=True)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
