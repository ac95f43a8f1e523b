"""Plant faults in the source of a room, drawn by a seed, and count how many its tests find.

    python scripts/mutants.py ROOM [...] [--count 20] [--seed 1] [--seconds 120]

A room is a name of `scripts/rooms.py`, such as ``verification.reference``. Every fault is one
change of a token in a copy of the checkout: another operator, comparison or number, a condition
that is negated. The tests are those that `scripts/check.py` runs for the changed file; a fault is
found if one of them is red or takes longer than the limit. Prints the faults that no test finds.
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
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from scripts.check import tests_of  # noqa: E402
from scripts.rooms import ROOMS, modules, room_of  # noqa: E402

OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.Gt, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Fault:
    """A changed expression: `old` at these places of a file becomes `new`."""

    file: Path
    line: int
    begin: int  # of the text of the file, bytes
    end: int
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line}: {self.old} -> {self.new}"


def faults_of(file: Path) -> Iterator[Fault]:
    """Yield every fault that can be planted in the functions of a file."""
    data = file.read_bytes()
    starts = [0]
    for line in data.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    tree = ast.parse(data)
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    inside = {node for function in functions for part in function.body for node in ast.walk(part)}
    for node in sorted(inside & set(_changeable(tree)), key=lambda n: (n.lineno, n.col_offset)):  # type: ignore[attr-defined]
        begin = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
        end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
        new = _changed(node)
        yield Fault(file, node.lineno, begin, end, data[begin:end].decode(), f"({new})")  # type: ignore[attr-defined]


def _changeable(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield expressions of which one operator or number can be changed."""
    for node in ast.walk(tree):
        match node:
            case ast.BinOp() | ast.BoolOp() if type(node.op) in OPERATORS:
                yield node
            case ast.Compare() if type(node.ops[0]) in OPERATORS:
                yield node
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float()) | ast.UnaryOp(op=ast.USub() | ast.Not()):
                yield node


def _changed(node: ast.AST) -> str:
    """Return the text of an expression with its change."""
    if isinstance(node, ast.Constant):
        return repr(node.value * 2 + 1)  # type: ignore[operator]
    if isinstance(node, ast.UnaryOp):
        return ast.unparse(node.operand)
    other = ast.parse(ast.unparse(node), mode="eval").body
    if isinstance(other, ast.Compare):
        other.ops[0] = OPERATORS[type(other.ops[0])]()  # type: ignore[call-overload]
    elif isinstance(other, ast.BinOp | ast.BoolOp):
        other.op = OPERATORS[type(other.op)]()  # type: ignore[assignment]
    return ast.unparse(other)


def is_found(fault: Fault, copy: Path, seconds: float) -> bool:
    """Plant a fault in a copy of the checkout, and tell whether a test finds it."""
    name = fault.file.relative_to(ROOT)
    data = fault.file.read_bytes()
    (copy / name).write_bytes(data[: fault.begin] + fault.new.encode() + data[fault.end :])
    tests = [str(file.relative_to(ROOT)) for file in tests_of([name.as_posix()])]
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    more = {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            words, cwd=copy, env=os.environ | more, capture_output=True, timeout=seconds
        )
        return done.returncode != 0
    except subprocess.TimeoutExpired:
        return False  # the tests that ran are green
    finally:
        (copy / name).write_bytes(data)


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
        skipped = shutil.ignore_patterns(".git", ".venv*", "__pycache__", "*_cache", "docs")
        shutil.copytree(ROOT, copy, symlinks=True, ignore=skipped)
        for room in asked.rooms:
            began = time.monotonic()
            files = [path for module, path in modules().items() if room_of(module) == room]
            every = [fault for file in files for fault in faults_of(file)]
            drawn = random.Random(asked.seed).sample(every, min(asked.count, len(every)))  # noqa: S311
            missed = [fault for fault in drawn if not is_found(fault, copy, asked.seconds)]
            for fault in missed:
                print(f"  not found: {fault}")
            score = f"{len(drawn) - len(missed)} of {len(drawn)} found"
            print(f"{room}: {score}, of {len(every)}, {time.monotonic() - began:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
