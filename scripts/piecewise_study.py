"""Compare random boards of piecewise linear amplifiers with independent transients and solvers.

    python scripts/piecewise_study.py [--boards 200] [--first 0]

Every board has a random matrix, op-amp, amplifier and share of the ridge term. The transient of
the state-space engine must lie within its own bound of that of `tests/support/kinked.py`, which
knows no modes and no search for switches; the reference's answer must be that of a proximal
gradient. Prints each board outside, and the counts. Needs the extra ``dev``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.piecewise_boards import NotComparableError, compare_board  # noqa: E402


def main() -> int:
    """Run the study; 1 if a board is outside."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boards", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first board")
    asked = parser.parse_args()
    compared, outside, seed, switches = 0, 0, asked.first, 0
    while compared < asked.boards:
        try:
            found = compare_board(seed)
        except NotComparableError as reason:
            print(f"{seed}: {reason}", flush=True)
        else:
            compared, switches = compared + 1, switches + found.switches
            outside += found.outside
            if found.outside:
                print(f"{seed} is outside: {found}", flush=True)
        seed += 1
    print(f"{outside} of {compared} boards outside, {switches} switches")
    return int(outside > 0)


if __name__ == "__main__":
    sys.exit(main())
