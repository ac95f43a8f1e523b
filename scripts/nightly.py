"""What takes too long for every commit: the full tables of which `.ci/run` runs a part.

python scripts/nightly.py [STEP ...]     run all steps, or these; status 1 if one is red
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
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
# Twenty times as many random scenes and seeds as in every commit; the tests marked `nightly`.
MORE = {
    "random-scenes": {
        "TACTION_RANDOM_SCENES": "200",
        "TACTION_ROUNDING_SCALE": "20",
        "TACTION_RANDOM_CIRCUITS": "3000",
    },
    "long-tests": {"TACTION_NIGHTLY": "yes"},
}


def main() -> int:
    """Run the steps; 1 if one is red."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("steps", nargs="*", choices=[*STEPS, []], metavar="STEP")
    failed = []
    for name in parser.parse_args().steps or STEPS:
        print(f"== {name}", flush=True)
        began = time.monotonic()
        environment = os.environ | {"CI": "true"} | MORE.get(name, {})
        green = subprocess.run(STEPS[name], cwd=ROOT, env=environment).returncode == 0
        word = "green" if green else "red"
        print(f"== {name}: {word}, {(time.monotonic() - began) / 60.0:.0f} min", flush=True)
        failed += [] if green else [name]
    print(f"nightly: red: {', '.join(failed) or 'none'}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
