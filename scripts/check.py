"""Lint, types and the tests of what changed since the last commit, in under 90 s.

    python scripts/check.py [REVISION]    what changed since REVISION; the default is HEAD

What does not fit into the time is named; `make test` runs everything.
"""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.rooms import ROOT, modules

SECONDS = 80.0
WITH_TOOLS = ("browser", "install", "kicad")
LINT = (("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",))


def changed(revision: str) -> list[str]:
    """Return the files that differ from `revision`, or that git does not know."""
    git = shutil.which("git") or "git"
    commands = ["diff", "--name-only", revision], ["ls-files", "--others", "--exclude-standard"]
    runs = [subprocess.run([git, *words], cwd=ROOT, capture_output=True) for words in commands]
    return sorted({line for run in runs for line in run.stdout.decode().splitlines()})


@cache
def imported(file: Path) -> set[str]:
    """Return the names that a test file imports, below `taction`, or of the tests' own helpers."""
    found = set()
    for node in ast.walk(ast.parse(text(file))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@cache
def text(file: Path) -> str:
    """Return what a file holds."""
    return file.read_text("utf-8")


def mirror(file: Path) -> Path:
    """Return the folder of the package that the folder of a test file mirrors."""
    return ROOT / "taction" / file.parent.relative_to(ROOT / "tests")


def tests_of(files: Sequence[str]) -> list[Path]:
    """Return the test files of changed files: themselves and those that import them.

    Those of its name, and of the folder that mirrors a module's, belong to it, too, the latter
    first: commands and views are found by their names. A file that is no Python, such as a scene,
    has the tests that name it. Tests that need a tool of their own are left out, as in `make test`.
    """
    names = {path: name for name, path in modules().items()}
    every = [file.relative_to(ROOT / "tests") for file in (ROOT / "tests").rglob("test_*.py")]
    tests = [ROOT / "tests" / file for file in every if file.parts[0] not in WITH_TOOLS]
    found = set[Path]()
    for path in (ROOT / name for name in files):
        if path in names:
            module = f"taction.{names[path].removeprefix('door.')}"
            named = f"test_{path.stem}.py"
            found |= {e for e in tests if mirror(e) == path.parent or e.name == named}
        else:
            module = path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
        python = path.suffix == ".py"
        using = (e for e in tests if (module in imported(e) if python else path.name in text(e)))
        found |= {path} & {*tests} | {*using}
    folders = {(ROOT / name).parent for name in files}
    return sorted(found, key=lambda file: (mirror(file) not in folders, file.stat().st_size))


def main() -> int:
    """Run everything; 1 if something is red."""
    end, python = time.monotonic() + SECONDS, [sys.executable, "-m"]
    files = changed(sys.argv[1] if len(sys.argv) > 1 else "HEAD")
    tests, status = [str(file.relative_to(ROOT)) for file in tests_of(files)], 0
    print(f"check: {len(files)} changed files, {len(tests)} test files", flush=True)
    jobs = [*LINT, *([("pytest", "-q", "-x", "-n", "2", *tests)] if tests else [])]
    for words in jobs:
        try:
            left = max(1.0, end - time.monotonic())
            status |= subprocess.run([*python, *words], cwd=ROOT, timeout=left).returncode
        except subprocess.TimeoutExpired:
            print(f"check: {words[0]} was stopped after {SECONDS:g} s; make test runs all")
            jobs = []
    print("check:", "red" if status else "green" if tests and jobs else "nothing red in what ran")
    return int(bool(status))


if __name__ == "__main__":
    sys.exit(main())
