"""Throughput of sweeps against the same decks run bare, and what resuming and memory cost.

Run from the checkout: ``python benchmarks/sweep.py [ROUNDS]``. The rounds take turns, so that
whatever else the machine does hits everybody; the best round of each counts. Beside the wall time
stands the processor time of all processes together, which says what idle cores would give.
spicelib and PySpice are compared where they (and libngspice) are installed.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from importlib import util
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT)]
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

from netlist_gen.deck import write_deck  # noqa: E402 - after the path
from netlist_gen.problem import make_problem  # noqa: E402
from netlist_gen.scene import Scene  # noqa: E402
from netlist_gen.scene_file import load_scene  # noqa: E402
from netlist_gen.synthesis import synthesise  # noqa: E402
from verification.engines.simulator import environment, find_simulator  # noqa: E402
from verification.plan import coarser, plan_transient  # noqa: E402
from verification.studies.axes import parse_axes, with_value, with_values  # noqa: E402
from verification.studies.axes import points as points_of  # noqa: E402
from verification.studies.executors import LocalPool, Workers  # noqa: E402
from verification.studies.grid import Plan  # noqa: E402
from verification.studies.point import NUMBERS, Result  # noqa: E402
from verification.studies.store import Store  # noqa: E402
from verification.studies.sweep import sweep  # noqa: E402
from verification.timescales import time_scales  # noqa: E402

JOBS = 2
POINTS = 30
OVER = f"C=10pF:30pF:{POINTS}"
CASES = {  # stop time of the scene: 500 points a deck, and as long as the board needs to settle
    "short decks": "0.1ms",
    "whole decks": "auto",
}


def make_plan(stop: str, engine: str, *, second_look: bool) -> Plan:
    """Return the sweep over `POINTS` seven-channel boards."""
    scene = load_scene(ROOT / "scenes" / "paper-breadboard.toml")
    scene = with_value(scene, "analysis.stop", stop)
    return Plan(scene, parse_axes(scene, [OVER]), (engine,), second_look=second_look)


def decks(plan: Plan, folder: Path) -> list[Path]:
    """Write every deck that the sweep would run, each into a folder of its own."""
    solver = find_simulator().solver_option
    found = []
    for k, values in enumerate(points_of(plan.groups)):
        scene = with_values(plan.scene, values)
        circuit = synthesise(scene, make_problem(scene))
        transient = plan_transient(scene, time_scales(circuit))
        for name, each in (("fine", transient), ("coarse", coarser(transient, 2.0))):
            if name == "fine" or plan.second_look:
                place = folder / f"{k}-{name}"
                place.mkdir()
                (place / "deck.cir").write_text(write_deck(circuit, each, solver=solver).text)
                (place / "spinit").write_text("* none\n")
                found.append(place)
    return found


@dataclass(frozen=True, slots=True)
class Cost:
    """Wall and processor time of all processes together, s."""

    wall: float
    processor: float


class Stopwatch:
    """Times what happens between its making and `stop`; `pids` are workers that live on."""

    def __init__(self, pids: list[int] | None = None) -> None:
        self._pids = pids or []
        self._wall, self._processor = time.perf_counter(), self._used()

    def stop(self) -> Cost:
        """Return the cost since the beginning."""
        return Cost(time.perf_counter() - self._wall, self._used() - self._processor)

    def _used(self) -> float:
        own = sum(os.times()[:4])  # with the children that have ended
        ticks = 0
        for pid in self._pids:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += sum(map(int, fields[11:15]))
        return own + ticks / os.sysconf("SC_CLK_TCK")


def by_xargs(plan: Plan, folder: Path) -> Cost:
    """Cost of ``xargs -P 2 ngspice -b`` over the decks, results and all."""
    places = decks(plan, folder)
    run = f'cd "$0" && HOME=$0 SPICE_SCRIPTS=$0 {find_simulator().executable} -b -n -r out.raw'
    words = ["xargs", "-P", str(JOBS), "-n", "1", "sh", "-c", f"{run} deck.cir >log 2>&1"]
    text = "\n".join(map(str, places)) + "\n"
    watch = Stopwatch()
    subprocess.run(words, input=text, text=True, check=True, env=environment(folder))
    cost = watch.stop()
    assert all((place / "out.raw").stat().st_size > 10_000 for place in places)
    return cost


def by_spicelib(plan: Plan, folder: Path) -> Cost:
    """Cost of spicelib's SimRunner with two parallel runs over the decks."""
    from spicelib import SimRunner
    from spicelib.simulators.ngspice_simulator import NGspiceSimulator

    places = decks(plan, folder)
    out = folder / "out"
    out.mkdir()
    runner = SimRunner(output_folder=str(out), parallel_sims=JOBS, simulator=NGspiceSimulator)
    watch = Stopwatch()
    for place in places:
        runner.run(str(place / "deck.cir"), run_filename=f"{place.name}.net", exe_log=True)
    runner.wait_completion()
    cost = watch.stop()
    assert runner.okSim == len(places)
    return cost


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


def best(rounds: int, contestants: dict[str, Callable[[Path], Cost]]) -> dict[str, Cost]:
    """Let everybody run in turn and return each one's least times."""
    found: dict[str, Cost] = {}
    for _ in range(rounds):
        for name, run in contestants.items():
            folder = Path(tempfile.mkdtemp(prefix="sweep-"))
            now = run(folder)
            old = found.get(name, now)
            found[name] = Cost(min(now.wall, old.wall), min(now.processor, old.processor))
            shutil.rmtree(folder)
    return found


RATIOS = (  # what is compared with what, and how it is said
    ("xargs, one deck", "sweep --once", "sweep --once against xargs on the same decks"),
    ("xargs, two decks", "sweep", "sweep against xargs on the same decks"),
    ("sweep", "state space", "state space against sweep"),
    ("sweep --once", "state space", "state space against sweep --once"),
    ("spicelib, one deck", "sweep --once", "sweep --once against spicelib's SimRunner"),
)


def throughput(rounds: int) -> None:
    """Print points per second of everybody, and how they compare."""
    pool = LocalPool(JOBS)
    pool.pids()
    for case, stop in CASES.items():
        full = make_plan(stop, "ngspice", second_look=True)
        once = make_plan(stop, "ngspice", second_look=False)
        exact = make_plan(stop, "statespace", second_look=True)
        contestants: dict[str, Callable[[Path], Cost]] = {
            "xargs, one deck": partial(by_xargs, once),
            "sweep --once": partial(by_sweep, once, pool=pool),
            "xargs, two decks": partial(by_xargs, full),
            "sweep": partial(by_sweep, full, pool=pool),
            "state space": partial(by_sweep, exact, pool=pool),
        }
        if util.find_spec("spicelib"):
            contestants["spicelib, one deck"] = partial(by_spicelib, once)
        costs = best(rounds, contestants)
        print(f"\n{case}: {POINTS} points, {JOBS} processes")
        for name, cost in costs.items():
            each = 1e3 * cost.processor / POINTS
            print(f"  {name:20} {POINTS / cost.wall:7.1f} points/s, {each:7.1f} ms of a core each")
        for slow, fast, text in RATIOS:
            if slow in costs:
                wall = costs[slow].wall / costs[fast].wall
                processor = costs[slow].processor / costs[fast].processor
                print(f"  {text}: {wall:.2f} by the clock, {processor:.2f} by processor time")
    pool.shutdown(wait=False, cancel_futures=True)


class Instant(Executor):
    """Gives every point a result at once: what is left is the sweep's own cost."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return a finished future."""
        words = {"failure": None, "reason": "", "engine": "statespace", "simulator": "statespace"}
        record = {"outcome": "pass", **words, "state": "settled", "stable": True, "checks": []}
        future: Future[Any] = Future()
        future.set_result(Result("pass", record | dict.fromkeys(NUMBERS, 1.0)))
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
    for package, why in (("spicelib", ""), ("PySpice", " or its libngspice")):
        missing = not util.find_spec(package) or (why and not shutil.which("libngspice.so"))
        if missing:
            print(f"\n{package}{why} is not installed: not compared")
    print("\nwithout any simulation (memory of the whole process, at its peak):")
    overhead(load_scene(ROOT / "scenes" / "paper-breadboard.toml"))


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
