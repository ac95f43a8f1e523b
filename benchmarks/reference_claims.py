"""A thousand random problems: count the wrong answers that the reference solver calls good.

Run from the checkout: ``python benchmarks/reference_claims.py [COUNT [SEED]]``. Ends with status 1
if there is one.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT)]

from tests.support.oracle import count_claims, random_problems  # noqa: E402 - after the path


def main(count: int = 1000, seed: int = 1993) -> int:
    """Count and print; return the exit status."""
    start = time.perf_counter()
    claims = count_claims(random_problems(seed, count))
    print(f"problems            {claims.asked}")
    blind = sum(problem.lam == 0.0 for problem in claims.inconclusive)
    print(f"inconclusive        {len(claims.inconclusive)}, {blind} of them with lambda = 0")
    print(f"false claims        {len(claims.false)}")
    print(f"worst error claimed {claims.worst!r} of the largest entry of u")
    print(f"seconds             {time.perf_counter() - start:.1f}")
    for problem in (*claims.inconclusive, *claims.false):
        if problem.lam > 0.0:
            size = float(np.linalg.norm(problem.T))
            print(f"  {problem.regulariser}, {problem.T.shape}, lam {problem.lam!r}, |T| {size!r}")
    return 1 if claims.false else 0


if __name__ == "__main__":
    sys.exit(main(*(int(argument) for argument in sys.argv[1:])))
