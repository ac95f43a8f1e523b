"""What studies cost: a point, the sweep of the README, the search for changes.

A point of a study is the wall time that 120 further points add to a `sweep` by the state-space
engine in one process; its baseline is `numpy.linalg.eig` of a random matrix of the board's size.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.measuring import (
    IMPORTS,
    SCENES,
    Cost,
    Figure,
    imports,
    in_seconds,
    in_turns,
    processor,
    ratios,
    taction,
)
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import load_scene
from taction.verification.design.remedies import find_remedies
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.verdict.verify import verify

STUDIED = {
    "paper-breadboard": "C=10pF:100pF",
    "eleven-channel": "C=20pF:200pF",
    "tuned-breadboard": "C=20pF:200pF",
}
POINT = 4.0  # wanted: a point over an eigenvalue decomposition
ENGINES = {"ngspice": 22.0, "statespace": 8.0}  # wanted seconds of the README's sweep, two cores
CHANGES = 3.0  # s, wanted of a search for changes
FAILING = [
    (C, gain) for C in ("5pF", "8pF", "200pF", "1nF") for gain in ("1Mohm", "6Mohm", "20Mohm")
]


def measure(tiny: bool) -> list[Figure]:
    """Measure every row in turns with its baseline."""
    names = list(STUDIED)[:1] if tiny else list(STUDIED)
    figures = [of_a_point(name, 40 if tiny else 120, 1 if tiny else 3) for name in names]
    figures += of_the_readme(2 if tiny else 31, 2 if tiny else 21)
    return [*figures, changes(FAILING[:1] if tiny else FAILING)]


def by_command(scene: Path, over: tuple[str, ...], engine: str, jobs: int = 2) -> Cost:
    """Cost of a whole sweep command."""
    with tempfile.TemporaryDirectory() as folder:
        words = [word for axis in over for word in ("--over", axis)]
        more = ("--fix", "lambda", "--engine", engine, "--jobs", f"{jobs}")
        return taction("sweep", str(scene), *words, *more, "-o", f"{folder}/sweep.sqlite")


def of_a_point(name: str, count: int, rounds: int) -> Figure:
    """Compare a point of a sweep in one process with an eigenvalue decomposition."""
    scene, axis = SCENES / f"{name}.toml", STUDIED[name]
    size = LinearBoard(synthesise(load_scene(scene))).state_space.n
    matrix = np.random.default_rng(1).standard_normal((size, size))

    def added() -> float:
        many, one = (
            by_command(scene, (f"{axis}:{each}",), "statespace", jobs=1).wall
            for each in (count + 2, 2)
        )
        return (many - one) / count

    decompose = processor(lambda: np.linalg.eig(matrix))
    jobs = {"point": added, "eig": lambda: statistics.median(decompose() for _ in range(20))}
    found = in_turns(jobs, rounds, warm=False)
    what = f"a point of {count} of a sweep by state space, {name}"
    over = f"eig of a random matrix of {size}"
    return Figure(what, over, ratios(found["point"], found["eig"]), POINT)


def of_the_readme(rows: int, columns: int) -> list[Figure]:
    """Sweep by each engine."""
    over = (f"C=10pF:10nF:{rows}", f"gain=20k:400k:{columns}")  # those of the README
    with tempfile.TemporaryDirectory() as place:
        scene = Path(place) / "board.toml"
        taction("new", str(scene))
        jobs: dict[str, Callable[[], Cost]] = {
            IMPORTS: imports,
            **{engine: partial(by_command, scene, over, engine) for engine in ENGINES},
        }
        found = in_turns(jobs, 1, warm=False)
    wall = {name: [cost.wall for cost in costs] for name, costs in found.items()}
    what = f"sweep of {rows} x {columns} points"
    return [
        in_seconds(f"{what}, {engine}", wall[engine], wall[IMPORTS], wanted)
        for engine, wanted in ENGINES.items()
    ]


def changes(failing: list[tuple[str, str]]) -> Figure:
    """Time the search for changes of failed verdicts of the paper's board; the longest counts."""
    base, spent, times = load_scene(SCENES / "paper-breadboard.toml"), list[float](), list[float]()
    for C, gain in failing:
        values = {"design.capacitance": C, "design.gain": gain}
        search = partial(find_remedies, verify(with_values(base, values).with_engine("statespace")))
        spent.append(processor(search)())
        times.append(spent[-1] / imports().processor)
    what = f"search for changes at {len(failing)} (C, gain) of paper-breadboard, longest"
    return Figure(what, IMPORTS, times, CHANGES, max(spent), "s")
