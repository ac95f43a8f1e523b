"""Throughput of sweeps against the same decks run by others, and what resuming and memory cost.

Run from the checkout: ``python benchmarks/sweep.py [ROUNDS]``. The rounds take turns, so that
whatever else the machine does hits everybody; the best round of each counts. Beside the wall time
stands the processor time of all processes together, which says what idle cores would give.

spicelib and PySpice are compared where they are installed; PySpice needs libngspice of the same
version as ngspice, wherever NGSPICE_LIBRARY_PATH says it is (see `sweep_rivals`).
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT)]
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

from sweep_decks import CASES, JOBS, POINTS, Cost, Stopwatch, by_xargs, make_plan  # noqa: E402
from sweep_rivals import SharedLibrary, by_spicelib, why_no_spicelib  # noqa: E402

from netlist_gen.overrides.axes import parse_axes  # noqa: E402
from netlist_gen.scene.file import load_scene  # noqa: E402
from netlist_gen.scene.scene import Scene  # noqa: E402 - after the path
from verification.studies.figures import FIGURES  # noqa: E402
from verification.studies.running.executors import LocalPool, Workers  # noqa: E402
from verification.studies.sweep.plan import Plan  # noqa: E402
from verification.studies.sweep.run import sweep  # noqa: E402
from verification.studies.sweep.store import Store, StoredResult  # noqa: E402

TimedRun = Callable[[Path], Cost]


def by_sweep(plan: Plan, folder: Path, pool: LocalPool) -> Cost:
    """Cost of a sweep from nothing to everything stored, its workers at hand."""
    workers = Workers(pool, lambda: JOBS + 2, ())
    with Store(str(folder / "a.sqlite")) as store:
        watch = Stopwatch(pool.pids())
        count = sweep(plan, store, workers)
        cost = watch.stop()
    assert count.ran == POINTS, count
    assert not count.outcomes["error"], count
    return cost


@dataclass(frozen=True, slots=True)
class Score:
    """Least times of a contestant, and the overshoots that it stored, in order of size."""

    cost: Cost
    stored: list[float]


def stored(folder: Path) -> list[float]:
    """Return the overshoot of every point in the folder's database; empty if there is none."""
    if not (folder / "a.sqlite").exists():
        return []
    with closing(sqlite3.connect(folder / "a.sqlite")) as database:
        rows = database.execute("select record from points").fetchall()
    return sorted(json.loads(record)["overshoot"] for (record,) in rows)


def best(rounds: int, contestants: dict[str, TimedRun]) -> dict[str, Score]:
    """Let everybody run in turn and return each one's least times."""
    found: dict[str, Score] = {}
    for _ in range(rounds):
        for name, run in contestants.items():
            folder = Path(tempfile.mkdtemp(prefix="sweep-"))
            now = run(folder)
            old = found[name].cost if name in found else now
            least = Cost(min(now.wall, old.wall), min(now.processor, old.processor))
            found[name] = Score(least, stored(folder))
            shutil.rmtree(folder)
    return found


ONCE = "sweep --once"
SPICELIB, WAITLESS, SHARED = "spicelib", "spicelib, no waits", "PySpice, one core"
CLOCK, CORE = {"wall": "by the clock"}, {"processor": "by processor time"}
BOTH = CLOCK | CORE
TWO = ", two decks"
RATIOS = (  # who, times as fast as whom, and what is to be reached
    (ONCE, "xargs, one deck", BOTH, 0.9),
    ("sweep", "xargs, two decks", BOTH, 0.9),
    ("state space", "sweep", BOTH, 20.0),
    ("state space", ONCE, BOTH, 20.0),
    (ONCE, f"{SPICELIB}, bare", CLOCK, 7.0),
    (ONCE, f"{SPICELIB}, measured", CLOCK, 7.0),
    (ONCE, f"{WAITLESS}, bare", CLOCK, None),
    (ONCE, f"{WAITLESS}, measured", CLOCK, None),
    (ONCE, f"{SHARED}, bare", CORE, 1.0),
    (ONCE, f"{SHARED}, measured", CORE, 1.0),
    ("sweep", f"{SPICELIB}{TWO}, bare", CLOCK, 7.0),
    ("sweep", f"{SPICELIB}{TWO}, measured", CLOCK, 7.0),
    ("sweep", f"{SHARED}{TWO}, bare", CORE, 1.0),
    ("sweep", f"{SHARED}{TWO}, measured", CORE, 1.0),
)


def rivals(once: Plan, full: Plan, library: SharedLibrary | None) -> dict[str, TimedRun]:
    """Return other people's runners, as far as they are at hand."""
    found: dict[str, TimedRun] = {}
    for what in ("bare", "measured"):
        measured = what == "measured"
        for plan, decks in ((once, ""), (full, TWO)):
            if not why_no_spicelib():
                for name, waits in ((SPICELIB, True), (WAITLESS, False)):
                    run = partial(by_spicelib, plan, measured=measured, waits=waits)
                    found[f"{name}{decks}, {what}"] = run
            if library is not None:
                run = partial(library.run, plan, measured=measured)
                found[f"{SHARED}{decks}, {what}"] = run
    return found


def throughput(rounds: int) -> None:
    """Print points per second of everybody, and how they compare."""
    pool, library = LocalPool(JOBS), SharedLibrary()
    pool.pids()
    with tempfile.TemporaryDirectory() as folder:
        missing = [why_no_spicelib(), library.why_not(Path(folder))]
    for case, stop in CASES.items():
        full = make_plan(stop, "ngspice", second_look=True)
        once = make_plan(stop, "ngspice", second_look=False)
        exact = make_plan(stop, "statespace", second_look=True)
        contestants: dict[str, TimedRun] = {
            "xargs, one deck": partial(by_xargs, once),
            ONCE: partial(by_sweep, once, pool=pool),
            "xargs, two decks": partial(by_xargs, full),
            "sweep": partial(by_sweep, full, pool=pool),
            "state space": partial(by_sweep, exact, pool=pool),
        } | rivals(once, full, None if missing[1] else library)
        print(f"\n{case}: {POINTS} points, {JOBS} processes where nothing else is said")
        print_scores(best(rounds, contestants))
    for why in filter(None, missing):
        print(f"\nnot compared: {why}")
    library.close()
    pool.shutdown(wait=False, cancel_futures=True)


def print_scores(scores: dict[str, Score]) -> None:
    """Print a table of `scores`, their ratios, and whether everybody stored the same."""
    for name, score in scores.items():
        each = 1e3 * score.cost.processor / POINTS
        speed = f"{POINTS / score.cost.wall:7.1f} points/s"
        print(f"  {name:38} {speed}, {each:7.1f} ms of a core each")
    for fast, slow, times, least in RATIOS:
        if slow in scores:
            costs = scores[slow].cost, scores[fast].cost
            ratios = [
                f"{getattr(costs[0], time) / getattr(costs[1], time):.2f} times {words}"
                for time, words in times.items()
            ]
            wanted = "" if least is None else f" (to reach: {least:g})"
            print(f"  {fast} against {slow}: {', '.join(ratios)}{wanted}")
    for name, score in scores.items():
        if name.endswith("measured") and TWO not in name:
            pairs = zip(score.stored, scores[ONCE].stored, strict=True)
            worst = max(abs(a - b) for a, b in pairs)
            print(f"  {name}: stored overshoots differ from {ONCE}'s by {worst:.1e}")


class Instant(Executor):
    """Gives every point a result at once: what is left is the sweep's own cost."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return a finished future."""
        words = {"failure": None, "reason": "", "engine": "statespace", "simulator": "statespace"}
        record: dict[str, Any] = {
            "outcome": "pass",
            **words,
            "state": "settled",
            "stable": True,
            "checks": [],
        }
        future: Future[Any] = Future()
        future.set_result(StoredResult("pass", record | dict.fromkeys(FIGURES, 1.0)))
        return future


def overhead(scene: Scene) -> None:
    """Print what a point costs beyond its computation, what resuming costs, and the memory."""
    workers = Workers(Instant(), lambda: JOBS, ())
    for points in (1000, 10_000):
        folder = Path(tempfile.mkdtemp(prefix="sweep-"))
        plan = Plan(scene, parse_axes(scene, [f"C=1pF:1nF:{points}"]), ("statespace",))
        for what in ("first", "resumed"):
            with Store(str(folder / "a.sqlite")) as store:
                began = time.perf_counter()
                count = sweep(plan, store, workers)
                seconds = time.perf_counter() - began
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            text = f"{seconds:7.2f} s, {1e3 * seconds / points:.3f} ms each, peak {peak:.0f} MB"
            print(f"  {points:6} points {what:8} {text}")
            assert count.done == points
        shutil.rmtree(folder)


def main(rounds: int = 3) -> None:
    """Run everything."""
    throughput(rounds)
    print("\nwithout any simulation (memory of the whole process, at its peak):")
    overhead(load_scene(ROOT / "scenes" / "paper-breadboard.toml"))


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
