"""``python -m tests.bench``: boards that pass, each with 100 drawn ones in ngspice."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.bench.boards import SOURCES, board_of, written
from tests.bench.judge import Judgement, judged


def main() -> int:
    """Judge the boards; the exit status is 1 if the PASS of one is wrong."""
    parser = argparse.ArgumentParser(prog="make boards", description=__doc__)
    parser.add_argument("sources", nargs="*", default=SOURCES, help="presets and problems")
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--ngspice", default="ngspice")
    parser.add_argument("--folder", type=Path, help="keep the scene files here")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as own, ThreadPoolExecutor(options.jobs) as pool:
        folder = options.folder or Path(own)
        folder.mkdir(parents=True, exist_ok=True)

        def judge(source: str) -> list[Judgement]:
            found = []
            try:
                for file in written(folder, source):
                    board = board_of(file)
                    found.append(judged(board, options.ngspice, options.draws, options.seed))
                    print(line(found[-1]), flush=True)
            except Exception as error:  # another source may still be judged
                found.append(Judgement(source, repr(error), ("",)))
                print(line(found[-1]), flush=True)
            return found

        found = [each for group in pool.map(judge, options.sources) for each in group]
    wrong = [each for each in found if not each.good]
    print(f"{len(found)} boards with PASS, {len(wrong)} of them wrong")
    return int(bool(wrong) or not found)


def line(found: Judgement) -> str:
    """Return what is said about one board."""
    most = Counter(text.split(" by ")[0].split(" after ")[0] for text in found.faults if text)
    kinds = Counter[str]()
    for text, count in most.items():
        kinds[" ".join(text.split()[:1])] += count
    why = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    said = found.as_written or "pass"
    word = "ok   " if found.good else "WRONG"
    return f"{word} {found.name:36} as written: {said}; drawn: {found.passing:.0%} pass {why}"


if __name__ == "__main__":
    sys.exit(main())
