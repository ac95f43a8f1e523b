"""The sweep of the README: by each engine, and its decks run by others.

The others only simulate. The sweep also has poles, measurements, checks and the comparison of
engines at every point, and stores them.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.bare import solver
from benchmarks.measuring import (
    Cost,
    Extent,
    Figure,
    Result,
    Table,
    in_turns,
    python,
    ratios,
    taction,
)
from benchmarks.rivals import by_xargs, rivals
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import parse_axes, points, with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.system.progress import Clock
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.store import Store, StoredResult
from taction.verification.studies.sweep.plan import Plan, plan_sweep
from taction.verification.studies.sweep.run import sweep
from taction.verification.verdict.design import design_board
from taction.verification.verdict.record import FIGURES, Record

SIZES = {Extent.TINY: (2, 2, 20), Extent.QUICK: (31, 21, 1000), Extent.FULL: (31, 21, 10_000)}
ENGINES = {"ngspice": 180.0, "hybrid": 30.0, "statespace": 4.0}  # wanted seconds on two cores
TWO, ONE = "ngspice", "ngspice, one process"
OTHERS = {"xargs": (TWO, 0.9), "spicelib": (TWO, 7.0), "PySpice": (ONE, 1.0)}
"""Who is compared with which sweep, and the wanted ratio of their time to that of the sweep."""
ROUNDS = {Extent.TINY: 1, Extent.QUICK: 1, Extent.FULL: 3}
IMPORTS = "import of scipy.linalg and pydantic"
RESUME = "from benchmarks.sweeps import store; store(int(sys.argv[1]), sys.argv[2])"


def measure(extent: Extent) -> Result:
    """Sweep by each engine and by others; then store and resume without any simulation."""
    rows, columns, stored = SIZES[extent]
    over = (f"C=10pF:10nF:{rows}", f"gain=20k:400k:{columns}")  # those of the README
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        scene = folder / "board.toml"
        taction("new", str(scene))
        write_decks(scene, over, folder / "decks")
        jobs: dict[str, Callable[[], Cost]] = {
            IMPORTS: lambda: python("import scipy.linalg, pydantic"),
            **{engine: partial(by_command, scene, over, engine) for engine in ENGINES},
        }
        others = rivals() if extent is not Extent.QUICK else {"xargs": by_xargs}
        jobs |= {who: partial(run, folder / "decks") for who, run in others.items()}
        if "PySpice" in others:
            jobs[ONE] = partial(by_command, scene, over, "ngspice", jobs=1)
        costs = in_turns(jobs, ROUNDS[extent], warm=False)
    found = {who: [cost.wall for cost in each] for who, each in costs.items()}
    count = f"sweep of {rows} x {columns} points"
    figures = []
    for engine, wanted in ENGINES.items():
        times, typical = ratios(found[engine], found[IMPORTS]), statistics.median(found[engine])
        figures.append(Figure(f"{count}, {engine}", IMPORTS, times, wanted, typical, "s"))
    for who, (own, wanted) in OTHERS.items():
        if who in found:
            what, times = f"{who}, only the simulations", ratios(found[who], found[own])
            figures.append(Figure(what, f"{count}, {own}", times, wanted, least=True))
    seconds = [(who, f"{statistics.median(times):.2f}") for who, times in found.items()]
    table = Table("The sweep of the README", ("", "wall, s"), seconds)
    return Result([*figures, *resumed(stored)], [table])


def by_command(scene: Path, over: tuple[str, ...], engine: str, jobs: int = 2) -> Cost:
    """Cost of a whole sweep command."""
    with tempfile.TemporaryDirectory() as folder:
        words = [word for axis in over for word in ("--over", axis)]
        database = f"{folder}/sweep.sqlite"
        more = ("--fix", "lambda", "--engine", engine, "--jobs", f"{jobs}", "-o", database)
        return taction("sweep", str(scene), *words, *more)


def write_decks(file: Path, over: tuple[str, ...], folder: Path) -> None:
    """Write the deck of every point of the sweep into a folder of its own."""
    plan = plan_sweep(file, over, "ngspice", fix=("lambda",), keep_waveforms=False)
    for k, values in enumerate(points(plan.groups)):
        scene = with_values(plan.scene, values).with_engine("ngspice")
        design = design_board(scene, Clock(lambda stage: None))
        place = folder / f"{k:04}"
        place.mkdir(parents=True)
        deck = write_deck(design.circuit, design.transient, solver=solver())
        (place / "deck.cir").write_text(deck.text)
        (place / "spinit").write_text("* none\n")


class Instant(Executor):
    """Gives every point a result at once, so that the cost of the sweep itself remains."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return a finished future with a result for each point of the call."""
        figures: dict[str, float | None] = dict.fromkeys(FIGURES, 1.0)
        record = Record("pass", "statespace", state="settled", stable=True, figures=figures)
        future: Future[Any] = Future()
        future.set_result([StoredResult.of(record) for _ in args])
        return future


def store(count: int, database: str) -> None:
    """Sweep `count` points that need no simulation."""
    scene = load_scene("scenes/paper-breadboard.toml")
    plan = Plan(scene, parse_axes(scene, [f"C=1pF:1nF:{count}"]), ("statespace",))
    with Store(database) as opened:
        assert sweep(plan, opened, Workers(Instant(), lambda: 2, ())).done == count


def resumed(count: int) -> list[Figure]:
    """Measure a resumed sweep of `count` stored points, and its memory beside a tenth of them."""
    with tempfile.TemporaryDirectory() as folder:
        few, many, again = (
            python(RESUME, f"{number}", f"{folder}/{number}.sqlite")
            for number in (count // 10, count, count)
        )
    return [
        Figure(f"resuming {count} points", "storing them", [again.wall / many.wall], 1.0),
        Figure(f"memory of {count} points", f"{count // 10}", [many.memory / few.memory], 1.1),
    ]
