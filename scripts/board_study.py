"""Compare random boards with witnesses that share no code with the engine.

    python scripts/board_study.py loops|straight-pieces|driven [--boards 200] [--first 0]

``loops``: closed-loop boards (inv, pinv, ridge), each with a random matrix, way of negative
entries, op-amp of one or two poles, capacitance and gf. Every number of the verdict must lie within
its bound of the modes of the deck's text (`tests/support/exact_readings.py`).

``straight-pieces``: boards of piecewise linear amplifiers. The transient must lie within its bound
of that of `tests/support/kinked.py`, which knows no modes and no search for switches; the
reference's answer must be that of a proximal gradient.

``driven``: strongly driven boards of five amplifiers, and of op-amps with limits. Every number and
check of the verdict beside the deck's text, integrated by `tests/support/collocation.py`.

Prints each board outside, and the counts. Needs the extra ``dev``.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tests.support import driven_boards, loop_boards, piecewise_boards  # noqa: E402

KINDS = {
    "loops": loop_boards.compare_board,
    "straight-pieces": piecewise_boards.compare_board,
    "driven": driven_boards.compare_board,
}


def main() -> int:
    """Run the study; 1 if a board is outside."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--boards", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first board")
    asked = parser.parse_args()
    compared, outside, seed, counts = 0, 0, asked.first, Counter[str]()
    while compared < asked.boards:
        try:
            found = KINDS[asked.kind](seed)
        except piecewise_boards.NotComparableError as reason:
            print(f"{seed}: {reason}", flush=True)
        else:
            compared += 1
            counts.update(found.counts)
            if found.outside:
                outside += 1
                print(f"{seed} is outside: {found}", flush=True)
        seed += 1
    more = "".join(f", {count:g} {name}" for name, count in counts.items())
    print(f"{outside} of {compared} boards outside{more}")
    return int(outside > 0)


if __name__ == "__main__":
    sys.exit(main())
