"""Plant faults in the source of a room, drawn by a seed, and count how many its tests find.

    python scripts/mutants.py ROOM [...] [--count 20] [--seed 1] [--seconds 120]

A room is a name of `scripts/rooms.py`, such as ``verification.reference``. Every fault is one
change in a copy of the checkout: another operator, comparison or number, a condition that is
negated. The tests are those that `scripts/check.py` runs for the changed file; a fault is found if
one of them is red. Prints the faults that no test finds.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from scripts.check import tests_of  # noqa: E402
from scripts.rooms import ROOMS, modules, room_of  # noqa: E402

PAIRS = (
    (ast.Add, ast.Sub), (ast.Mult, ast.Div), (ast.Lt, ast.Gt), (ast.LtE, ast.GtE),
    (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn), (ast.And, ast.Or),
)  # fmt: skip
OTHER: dict[type[ast.AST], Any] = dict(PAIRS) | {b: a for a, b in PAIRS}
# A fault may send signals to every process that this user has: tests see no other processes.
ALONE = ("unshare", "--user", "--map-root-user", "--pid", "--fork", "--mount-proc", "--kill-child")
Place = tuple[Path, int]  # a file, and the number of a changeable expression in it


def changes(tree: ast.AST) -> Iterator[tuple[ast.expr, Callable[[], None]]]:
    """Yield every expression in a function that has one thing to change, and what changes it."""
    functions = ast.FunctionDef | ast.AsyncFunctionDef
    bodies = [part for f in ast.walk(tree) if isinstance(f, functions) for part in f.body]
    for node in dict.fromkeys(each for part in bodies for each in ast.walk(part)):
        match node:
            case ast.BinOp() | ast.BoolOp() if type(node.op) in OTHER:
                yield node, lambda node=node: setattr(node, "op", OTHER[type(node.op)]())
            case ast.Compare() if type(node.ops[0]) in OTHER:
                other = [OTHER[type(node.ops[0])](), *node.ops[1:]]
                yield node, lambda node=node, other=other: setattr(node, "ops", other)
            case ast.UnaryOp(op=ast.USub() | ast.Not()):
                inner = ast.UnaryOp(node.op, node.operand)
                yield node, lambda node=node, inner=inner: setattr(node, "operand", inner)
            case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
                yield node, lambda node=node: setattr(node, "value", 2 * node.value + 1)


def is_found(place: Place, copy: Path, seconds: float) -> str:
    """Plant a fault in a copy of the checkout; return an empty text if a test finds it."""
    file, number = place
    name, tree = file.relative_to(ROOT), ast.parse(file.read_text("utf-8"))
    node, change = list(changes(tree))[number]
    before = ast.unparse(node)
    change()
    (copy / name).write_text(ast.unparse(tree), "utf-8")
    tests = [str(test.relative_to(ROOT)) for test in tests_of([name.as_posix()])]
    words = [*ALONE, sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    env = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(words, cwd=copy, env=env, capture_output=True, timeout=seconds)
        found = done.returncode != 0
    except subprocess.TimeoutExpired:
        found = False  # the tests that ran are green
    shutil.copy(file, copy / name)
    return "" if found else f"{name}:{node.lineno}: {before} -> {ast.unparse(node)}"


def main() -> int:
    """Print the score of every room."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="+", choices=ROOMS, metavar="ROOM")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=120.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "checkout"
        skipped = shutil.ignore_patterns(".git", ".venv*", "__pycache__", "*_cache")
        shutil.copytree(ROOT, copy, symlinks=True, ignore=skipped)
        for room in asked.rooms:
            began = time.monotonic()
            files = [path for module, path in modules().items() if room_of(module) == room]
            sizes = {file: len(list(changes(ast.parse(file.read_text("utf-8"))))) for file in files}
            every = [(file, number) for file, size in sizes.items() for number in range(size)]
            drawn = random.Random(asked.seed).sample(every, min(asked.count, len(every)))  # noqa: S311
            missed = [text for place in drawn if (text := is_found(place, copy, asked.seconds))]
            for text in missed:
                print(f"  not found: {text}")
            score = f"{len(drawn) - len(missed)} of {len(drawn)} found"
            print(f"{room}: {score}, of {len(every)}, {time.monotonic() - began:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
