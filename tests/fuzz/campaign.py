"""Fuzz every target in worker processes with limits, and count the outcomes.

A worker has `MOST_MEMORY` bytes above its start and `LONGEST` seconds for an input. It writes each
input to a file before it examines it, so that the input survives a worker that ends.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import math
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

LONGEST = 20.0  # s
MOST_MEMORY = 1_000_000_000  # bytes
BATCH = 2000  # inputs of one worker
FAILURES = Path("fuzz-failures")
ROOT = Path(__file__).parents[2]


def work(name: str, number: int, count: int, current: Path) -> Counter[str]:
    """Examine `count` inputs of a target in this process; `number` seeds them."""
    from tests.fuzz.targets import TARGETS

    target, outcomes = TARGETS[name], Counter[str]()
    _limit_memory()
    folder = Path(tempfile.mkdtemp(dir=current.parent))

    @seed(number)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        derandomize=False,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(target.inputs)
    def run(content: bytes) -> None:
        current.write_bytes(content)
        faulthandler.dump_traceback_later(LONGEST, exit=True)
        place = Path(tempfile.mkdtemp(dir=folder))
        try:
            outcome = target.outcome(content, place)
        except Exception as error:
            outcome = f"FAULT: {_place(error)}"
            _keep(name, outcome, content)
        finally:
            faulthandler.cancel_dump_traceback_later()
            shutil.rmtree(place, ignore_errors=True)
        outcomes[outcome] += 1

    run()
    return outcomes


def _limit_memory() -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_MEMORY,) * 2)


def _place(error: Exception) -> str:
    """Return the kind of an exception and the line of ours that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if frame.filename.startswith(str(ROOT))]
    at = [f for f in ours if ".venv" not in f.filename] or frames
    file = at[-1].filename.removeprefix(f"{ROOT}/")
    return f"{type(error).__name__} at {file}:{at[-1].lineno}"


def _keep(name: str, outcome: str, content: bytes) -> None:
    """Keep the shortest input of every kind of fault."""
    FAILURES.mkdir(exist_ok=True)
    words = "".join(c if c.isalnum() else "-" for c in f"{name} {outcome}")
    file = FAILURES / words[:150]
    if not file.exists() or file.stat().st_size > len(content):
        file.write_bytes(content)


def batch(name: str, number: int, count: int) -> Counter[str]:
    """Run a worker and return its outcomes; a worker that ended is a fault by itself."""
    with tempfile.TemporaryDirectory() as folder:
        current = Path(folder) / "input"
        words = ["--worker", name, "--seed", str(number), "--inputs", str(count)]
        done = subprocess.run(
            [sys.executable, "-m", "tests.fuzz", *words, "--current", str(current)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode == 0:
            return Counter(json.loads(done.stdout.splitlines()[-1]))
        late = "Timeout" in done.stderr
        outcome = f"FAULT: {'over 20 s' if late else f'worker ended with {done.returncode}'}"
        _keep(name, outcome, current.read_bytes() if current.exists() else b"")
        print(done.stderr[-3000:], file=sys.stderr)
        return Counter({outcome: 1})


def campaign(names: list[str], inputs: int, seconds: float, first: int) -> bool:
    """Run batches of all targets in turn; print the counts; return whether no fault was found."""
    totals: dict[str, Counter[str]] = {name: Counter() for name in names}
    began, number, done = time.monotonic(), first, 0
    size = min(BATCH, math.ceil(inputs / len(names)))
    while done < inputs and time.monotonic() - began < seconds:
        for name in names:
            totals[name].update(batch(name, number, size))
        done = sum(map(Counter.total, totals.values()))
        number += 1
        minutes = (time.monotonic() - began) / 60.0
        print(f"{done} inputs in {minutes:.1f} min", file=sys.stderr, flush=True)
    for name, outcomes in totals.items():
        print(f"\n{name}: {outcomes.total()} inputs")
        for outcome, times in sorted(outcomes.items()):
            print(f"  {times:8d}  {outcome}")
    faults = sum(n for c in totals.values() for o, n in c.items() if o.startswith("FAULT"))
    print(f"\n{done} inputs, {faults} faults (seeds {first} to {number - 1})")
    return faults == 0 and done > 0


def main() -> int:
    """Run a campaign, or one batch as its worker."""
    from tests.fuzz.targets import TARGETS

    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--inputs", type=int, default=10**9, help="at most so many")
    parser.add_argument("--only", action="append", choices=list(TARGETS), help="a target")
    parser.add_argument("--seed", type=int, help="of the first batch; by default a new one")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--current", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    first = random.SystemRandom().randrange(10**6) if asked.seed is None else asked.seed
    if asked.worker:
        print(json.dumps(work(asked.worker, first, asked.inputs, asked.current)))
        return 0
    names = asked.only or list(TARGETS)
    return 0 if campaign(names, asked.inputs, 60.0 * asked.minutes, first) else 1
