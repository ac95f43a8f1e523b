"""Time and memory of Toeplitz problems up to a million channels.

Run from the checkout: ``python benchmarks/reference_size.py [CHANNELS]``. Kernel (19) at depth 1 on
a grid of spacing 0.25, a load with gaps, noise of standard deviation 0.1.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from verification.reference.problem import ToeplitzProblem  # noqa: E402 - after the path
from verification.reference.toeplitz import solve_toeplitz_problem  # noqa: E402 - after the path
from verification.reference.toeplitz_products import ToeplitzMatrix  # noqa: E402 - after the path

SPACING = 0.25
LAMBDAS = {"linear": (10.0, 0.01, 1e-4), "exponential": (10.0, 0.1, 0.01)}


def main(channels: int = 1_000_000) -> None:
    """Print a line for every lam."""
    y = SPACING * np.arange(channels)
    column = 1.5 / np.pi * (1.0 - y * y) / (1.0 + y * y) ** 2
    load = np.maximum(0.0, np.sin(y / 7.3) + 0.5 * np.sin(y / 3.1 + 1.0) - 0.5)
    noise = 0.1 * np.random.default_rng(0).standard_normal(channels)
    eps = ToeplitzMatrix(column, column).product(load) + noise
    print(f"{'':12} {'lam':>8} {'seconds':>8} {'steps':>5} {'bound/peak':>10} {'peak memory':>11}")
    for regulariser, lams in LAMBDAS.items():
        for lam in lams:
            problem = ToeplitzProblem(column, column, eps, lam, regulariser)
            answer = solve_toeplitz_problem(problem)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            claim = answer.error_bound / float(np.max(np.abs(answer.u)))
            print(
                f"{regulariser:12} {lam:8.0e} {answer.seconds:8.2f} {answer.iterations:5d} "
                f"{claim if answer.trusted else float('nan'):10.0e} {memory:8.0f} MB",
                flush=True,
            )


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
