"""Lint, types and the tests of what changed since the last commit, in under 90 s.

    python scripts/check.py [REVISION]    what changed since REVISION; the default is HEAD

The tests of a module are those whose files import it, the file that mirrors it first, and those of
the folder that mirrors its folder. What does not fit into the time is named; `make test` runs
everything.
"""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
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
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def tests_of(files: Iterable[str]) -> list[Path]:
    """Return the test files of changed files: themselves, mirrors, those that import them.

    Last come the others of the folder that mirrors a module's: commands and views are found by
    their names, and no test imports them. A changed file that is no Python, such as a scene, has
    the tests that name it. Tests that need a tool of their own are left out, as in `make test`.
    """
    names = {path.relative_to(ROOT).as_posix(): name for name, path in modules().items()}
    every = sorted((ROOT / "tests").rglob("test_*.py"))
    every = [file for file in every if file.relative_to(ROOT / "tests").parts[0] not in WITH_TOOLS]
    imports = {file: imported(file) for file in every}
    places: dict[Path, int] = {}
    for name in files:
        path = ROOT / name
        if path in imports:
            places[path] = 0
            continue
        module = name.removesuffix(".py").replace("/", ".")
        mirrored = (ROOT / "tests" / name.removeprefix("taction/")).parent
        if name in names:
            module = f"taction.{names[name].removeprefix('door.')}"
        python = path.suffix == ".py"
        for file in every:
            if module in imports[file] if python else path.name in file.read_text("utf-8"):
                mirror = file.name in {f"test_{path.stem}.py", f"test_{path.parent.name}.py"}
                places[file] = min(places.get(file, 2), 1 if mirror else 2)
            elif name in names and file.parent == mirrored:
                places.setdefault(file, 3)
    return sorted(places, key=lambda file: (places[file], file.stat().st_size))


def main() -> int:
    """Run everything; 1 if something is red."""
    end = time.monotonic() + SECONDS
    files = changed(sys.argv[1] if len(sys.argv) > 1 else "HEAD")
    python, status = [sys.executable, "-m"], 0
    types = subprocess.Popen([*python, *LINT[2]], cwd=ROOT)
    for words in LINT[:2]:
        status |= subprocess.run([*python, *words], cwd=ROOT).returncode
    tests = [str(file.relative_to(ROOT)) for file in tests_of(files)]
    print(f"check: {len(files)} changed files, {len(tests)} test files", flush=True)
    if tests:
        run = [*python, "pytest", "-q", "-x", "-n", "2", "--dist", "loadfile"]
        run += ["--no-loadscope-reorder", *tests]  # the mirrors first, and not the largest
        try:
            status |= subprocess.run(run, cwd=ROOT, timeout=end - time.monotonic()).returncode
        except subprocess.TimeoutExpired:
            print(f"check: the tests were stopped after {SECONDS:g} s; make test runs all of them")
            tests = []
    try:  # the first run of mypy reads everything: half a minute of a free core
        status |= types.wait(max(1.0, end - time.monotonic()))
    except subprocess.TimeoutExpired:
        types.terminate()
        print("check: the types were not read to the end; make lint reads them")
        tests = []
    print("check:", "red" if status else "green" if tests else "nothing red in what was run")
    return int(bool(status))


if __name__ == "__main__":
    sys.exit(main())
