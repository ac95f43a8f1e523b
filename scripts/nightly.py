"""What takes too long for every commit: the full tables of which `.ci/run` runs a part.

    python scripts/nightly.py [STEP ...]     run all steps, or these; record them
    python scripts/nightly.py --stale        name the steps that were not green with these sources

`docs/nightly.toml` has, for each step, the hash of the sources that it depends on, the day, the
machine, the time that it took and whether it was green.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "docs" / "nightly.toml"
HEAD = "# Written by `make nightly`; `.ci/run` says which steps are not green with its sources.\n"
PACKAGE = ("taction", "requirements", "pyproject.toml")
SOURCES = (*PACKAGE, "tests", "scripts")
STEPS = {
    "processors": ("make", "test-processors"),
    "pythons": ("make", "test-pythons", "ARGS=--all"),
    "simulators": ("make", "test-simulators", "ARGS=--all"),
    "random-scenes": ("make", "test", "ARGS=tests/verification"),
    "long-tests": ("make", "test", "ARGS=-m nightly"),
    "fuzz": ("make", "fuzz"),
    "torture": ("make", "torture"),
    "boards": ("make", "boards"),
    "bare": ("make", "test-bare", "ARGS=make test-browser test-kicad test-install docs"),
    "newer-debian": ("make", "test-bare", "RELEASE=trixie", "ARGS=make demo test"),
    # Debian's testing suite has the newest Python, which no registry of packages has.
    "newest-debian": ("make", "test-bare", "RELEASE=forky", "ARGS=make demo test"),
}
# What a step reads besides the package; the others read all tests and scripts.
OWN = {
    "simulators": ("scripts/simulators.py", "scripts/older_ngspice.sh"),
    "fuzz": ("tests/fuzz", "tests/support", "tests/data"),
    "torture": ("tests/torture", "tests/support", "tests/data"),
    "boards": ("tests/bench", "tests/support", "tests/data"),
}
# Twenty times as many random scenes and seeds as in every commit; the tests marked `nightly`.
MORE = {
    "random-scenes": {
        "TACTION_RANDOM_SCENES": "200",
        "TACTION_ROUNDING_SCALE": "20",
        "TACTION_RANDOM_CIRCUITS": "3000",
    },
    "long-tests": {"TACTION_NIGHTLY": "yes"},
}


def git(*words: str) -> str:
    """Return what git says, or nothing where it fails or is missing."""
    command = [shutil.which("git") or "git", *words]
    try:
        run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    except OSError:
        return ""
    return run.stdout.strip() if run.returncode == 0 else ""


def source_hash(step: str) -> str:
    """Return the hash of the committed sources that a step depends on; "" without git."""
    names = PACKAGE + OWN[step] if step in OWN else SOURCES
    trees = [git("rev-parse", f"HEAD:{name}") for name in names]
    return hashlib.sha256(" ".join(trees).encode()).hexdigest()[:16] if all(trees) else ""


def recorded() -> dict[str, dict[str, Any]]:
    """Return the entries of the record by the names of their steps."""
    return tomllib.loads(RECORD.read_text("utf-8")) if RECORD.exists() else {}


def stale(entries: dict[str, dict[str, Any]], sources: Callable[[str], str]) -> list[str]:
    """Return a sentence for each step that was not green with its `sources` of today."""
    found = []
    for name in STEPS:
        entry = entries.get(name)
        if entry is None:
            found.append(f"{name}: never run")
        elif not entry["green"]:
            found.append(f"{name}: red on {entry['day']}")
        elif entry["sources"] != sources(name):
            found.append(f"{name}: green on {entry['day']}, with other sources")
    return found


def record(name: str, sources: str, green: bool, seconds: float) -> None:
    """Write the end of a step; the entries of the others stay."""
    entry = {
        "sources": sources,
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "minutes": round(seconds / 60.0),
        "green": green,
    }
    text = HEAD
    for step, values in sorted((recorded() | {name: entry}).items()):
        lines = (f"{key} = {json.dumps(value)}\n" for key, value in values.items())
        text += f'\n["{step}"]\n' + "".join(lines)
    RECORD.write_text(text, encoding="utf-8")


def main() -> int:
    """Run the steps; 1 if one is red. With `--stale` always 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stale", action="store_true", help="run nothing; say what is stale")
    parser.add_argument("steps", nargs="*", choices=[*STEPS, []], metavar="STEP")
    asked = parser.parse_args()
    if asked.stale:
        for line in stale(recorded(), source_hash):
            print(f"nightly: {line}")
        return 0
    if not git("rev-parse", "HEAD") or git("status", "--porcelain", "--", *SOURCES):
        print("nightly: commit the sources first: the record names them", file=sys.stderr)
        return 1
    failed = []
    for name in asked.steps or STEPS:
        print(f"== {name}", flush=True)
        began = time.monotonic()
        environment = os.environ | {"CI": "true"} | MORE.get(name, {})
        sources = source_hash(name)
        green = subprocess.run(STEPS[name], cwd=ROOT, env=environment).returncode == 0
        record(name, sources, green, time.monotonic() - began)
        failed += [] if green else [name]
    print(f"nightly: red: {', '.join(failed) or 'none'}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
