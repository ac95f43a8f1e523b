"""What a verdict costs: in a study, of hard boards, of large boards, and of a search for changes.

A point of a study is the wall time that 120 further points add to a `sweep` by the state-space
engine in one process; its baseline is `numpy.linalg.eig` of a random matrix of the board's size. A
warm point is the processor time of one of a batch of 15, as a worker of the sweep computes them.
Verdicts of this process are timed without imports. The imports of `verify` run with the threshold
of the garbage collector that the command sets, their baseline is a plain Python. The command
`corners` is timed as a whole, by wall time. All other times are processor times.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.measuring import (
    SCENES,
    Cost,
    Extent,
    Figure,
    Result,
    Table,
    in_turns,
    python,
    ratios,
    taction,
    wall,
)
from benchmarks.sweeps import by_command
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import draw
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import parse
from taction.verification.design.remedies import find_remedies
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.studies.running.versions import own_versions
from taction.verification.studies.sweep.point import PointJob, compute
from taction.verification.studies.tolerance.samples import evaluate, evaluate_together
from taction.verification.studies.tolerance.varied_board import prepare
from taction.verification.verdict.verify import verify

ROUNDS = {Extent.TINY: 1, Extent.QUICK: 3, Extent.FULL: 7}
POINTS = {Extent.TINY: 40, Extent.QUICK: 120, Extent.FULL: 120}
STUDIED = {
    "paper-breadboard": "C=10pF:100pF",
    "eleven-channel": "C=20pF:200pF",
    "tuned-breadboard": "C=20pF:200pF",
}
BATCH = 15  # points in a call of a worker
POINT = 3.0  # wanted: a point over an eigenvalue decomposition
EXPONENTIAL = {"paper-exponential": 0.6, "paper-exponential-devices": 0.8}  # wanted, s
BOARDS = {Extent.TINY: 2, Extent.QUICK: 16, Extent.FULL: 16}  # of a Monte Carlo study in one call
BOARD, TOGETHER, CORNERS = 0.06, 0.5, 20.0  # wanted: s a board, share of a board alone, s
CHAINS, CHAIN = (6, 9, 12), 1.0  # channels of first differences, and the wanted time, s
LARGE = {200: 2.5, 500: 12.0}  # channels, and the wanted processor time, s
MEMORY = 600.0  # MB, wanted of the largest board
CHANGES = 1.0  # s, wanted of a search for changes
FAILING = [
    (C, gain) for C in ("5pF", "8pF", "200pF", "1nF") for gain in ("1Mohm", "6Mohm", "20Mohm")
]
IMPORTS = "import of scipy.linalg and pydantic"
VERIFY = (
    "import taction.system.rare_collections, taction.verification.verdict.verify,"
    " taction.verification.report.views.verdict, taction.verification.report.renderers.terminal"
)
LARGE_SCENE = """
name = "large-board"
[problem]
kind = "tactile"
channels = {channels}
span = 16.0
quadrature = "rectangle"
[design]
amplifier = "linear"
capacitance = "220pF"
gain = "500kohm"
unit_conductance = "2uS"
lambda = 0.1
opamp = {{ base = "tl084", input_errors = "none" }}
stray_capacitance = "2pF"
[checks]
steady_state = {{ tolerance = 1e-2 }}
"""


def measure(extent: Extent) -> Result:
    """Measure every row in turns with its baseline."""
    tiny, rounds = extent is Extent.TINY, ROUNDS[extent]
    names = list(STUDIED)[:1] if tiny else list(STUDIED)
    figures = [of_a_point(name, POINTS[extent], rounds) for name in names]
    figures += [of_a_warm_point(name, 2 if tiny else BATCH, rounds) for name in names]
    figures += verdicts(CHAINS[:1] if tiny else CHAINS, {} if tiny else EXPONENTIAL, rounds)
    figures += samples("paper-exponential", BOARDS[extent], rounds)
    figures.append(changes(FAILING[:1] if tiny else FAILING))
    figures.append(imports(rounds))
    if tiny:
        return Result(figures)
    figures.append(corners("paper-exponential"))
    with tempfile.TemporaryDirectory() as place:
        large = large_boards(Path(place), rounds)
    return Result(figures + large.figures, large.tables)


def of_a_point(name: str, points: int, rounds: int) -> Figure:
    """Compare a point of a sweep in one process with an eigenvalue decomposition."""
    scene, axis = SCENES / f"{name}.toml", STUDIED[name]
    size = LinearBoard(synthesise(load_scene(scene))).state_space.n
    matrix = np.random.default_rng(1).standard_normal((size, size))

    def added() -> float:
        many, one = (
            by_command(scene, (f"{axis}:{count}",), "statespace", jobs=1).wall
            for count in (points + 2, 2)
        )
        return (many - one) / points

    decompose = wall(lambda: np.linalg.eig(matrix))
    jobs = {"point": added, "eig": lambda: statistics.median(decompose() for _ in range(20))}
    found = in_turns(jobs, rounds, warm=False)
    what = f"a point of {points} of a sweep by state space, {name}"
    over = f"eig of a random matrix of {size}"
    return Figure(what, over, ratios(found["point"], found["eig"]), POINT)


def of_a_warm_point(name: str, points: int, rounds: int) -> Figure:
    """Compare a point as a worker computes it with an eigenvalue decomposition."""
    base, versions = (
        load_scene(SCENES / f"{name}.toml").with_engine("statespace"),
        own_versions(False),
    )
    low, high = STUDIED[name].removeprefix("C=").split(":")
    values = np.geomspace(parse(low, "F"), parse(high, "F"), points).tolist()
    scenes = [with_values(base, {"design.capacitance": value}) for value in values]
    batch = [PointJob(scene, make_problem(scene), False, versions) for scene in scenes]
    size = LinearBoard(synthesise(base)).state_space.n
    matrix = np.random.default_rng(1).standard_normal((size, size))
    point, decompose = processor(partial(compute, *batch)), processor(lambda: np.linalg.eig(matrix))
    jobs = {
        "point": lambda: point() / points,
        "eig": lambda: statistics.median(decompose() for _ in range(20)),
    }
    found = in_turns(jobs, rounds)
    what, over = (
        f"a warm point of a sweep by state space, {name}",
        f"eig of a random matrix of {size}",
    )
    return Figure(what, over, ratios(found["point"], found["eig"]), POINT)


def chain(channels: int) -> Scene:
    """Return the scene of a board of first differences."""
    T = np.eye(channels) - np.eye(channels, k=1)
    strain = T @ np.exp(-4.0 * np.linspace(-1.0, 1.0, channels) ** 2)
    return Scene.from_arrays(
        T, strain, capacitance=16e-12, gain=2400.0, opamp="tl084", lam=0.02, unit_conductance="10uS"
    )


def verdicts(
    chains: tuple[int, ...], exponential: Mapping[str, float], rounds: int
) -> list[Figure]:
    """Time whole verdicts by the state-space engine in this process."""
    jobs: dict[str, tuple[Scene, float]] = {
        f"verify, first differences of {channels}": (chain(channels), CHAIN) for channels in chains
    }
    for name, wanted in exponential.items():
        jobs[f"verify, {name}"] = load_scene(SCENES / f"{name}.toml"), wanted
    found = in_turns(
        {IMPORTS: lambda: python("import scipy.linalg, pydantic").processor}
        | {
            name: processor(partial(verify, scene.with_engine("statespace")))
            for name, (scene, _) in jobs.items()
        },
        rounds,
    )
    return [seconds(name, found[name], found[IMPORTS], jobs[name][1]) for name in jobs]


def samples(name: str, count: int, rounds: int) -> list[Figure]:
    """Time Monte Carlo boards in one call, and each in a call of its own."""
    board = prepare(load_scene(SCENES / f"{name}.toml").with_engine("statespace"))
    drawn = [(board, k, draw(board.scene.tolerances, board.varied, 1, k)) for k in range(count)]

    def alone() -> None:
        for each in drawn:
            evaluate(*each)

    found = in_turns(
        {
            "together": processor(lambda: evaluate_together(*drawn)),
            "alone": processor(alone),
            IMPORTS: lambda: python("import scipy.linalg, pydantic").processor,
        },
        rounds,
    )
    times = [spent / count for spent in found["together"]]
    what, shares = f"a Monte Carlo board of {name}", ratios(found["together"], found["alone"])
    return [
        seconds(f"{what}, {count} in one call", times, found[IMPORTS], BOARD),
        Figure(f"{what}, {count} in one call", "one board a call", shares, TOGETHER),
    ]


def corners(name: str) -> Figure:
    """Time a whole `corners` command in two processes, wall time."""
    words = ("corners", str(SCENES / f"{name}.toml"), "--engine", "statespace", "--jobs", "2")
    spent, imports = taction(*words).wall, python("import scipy.linalg, pydantic").wall
    return Figure(f"corners of {name}, wall time", IMPORTS, [spent / imports], CORNERS, spent, "s")


def changes(failing: list[tuple[str, str]]) -> Figure:
    """Time the search for changes of failed verdicts of the paper's board; the longest counts."""
    base, longest, times = load_scene(SCENES / "paper-breadboard.toml"), 0.0, list[float]()
    for C, gain in failing:
        scene = with_values(base, {"design.capacitance": C, "design.gain": gain}).with_engine(
            "statespace"
        )
        search = partial(find_remedies, verify(scene))
        longest = max(longest, spent := processor(search)())
        times.append(spent / python("import scipy.linalg, pydantic").processor)
    what = f"search for changes at {len(failing)} (C, gain) of paper-breadboard, longest"
    return Figure(what, IMPORTS, times, CHANGES, longest, "s")


def imports(rounds: int) -> Figure:
    """Compare the imports of `verify` with those of its libraries."""
    jobs = {
        "verify": lambda: python(VERIFY).processor,
        IMPORTS: lambda: python("import scipy.linalg, pydantic").processor,
    }
    found = in_turns(jobs, rounds)
    return Figure("imports of verify", IMPORTS, ratios(found["verify"], found[IMPORTS]), 1.0)


def large_boards(folder: Path, rounds: int) -> Result:
    """Measure processor time and memory of whole commands of large linear boards."""
    figures, rows, peaks = [], [], list[float]()
    for channels, wanted in LARGE.items():
        scene = folder / f"{channels}.toml"
        scene.write_text(LARGE_SCENE.format(channels=channels))
        jobs: dict[str, Callable[[], Cost]] = {
            "verify": partial(taction, "verify", str(scene), "--engine", "statespace"),
            IMPORTS: partial(python, "import scipy.linalg, pydantic"),
        }
        found = in_turns(jobs, rounds, warm=False)
        times = {name: [cost.processor for cost in costs] for name, costs in found.items()}
        what = f"verify by state space, {channels} channels, processor time"
        figures.append(seconds(what, times["verify"], times[IMPORTS], wanted))
        peaks.append(max(cost.memory for cost in found["verify"]))
        rows.append((what, f"{figures[-1].measured:.2f}", f"{peaks[-1]:.0f}"))
    share = [peaks[-1] / python("").memory]
    what = f"peak memory, {channels} channels"
    figures.append(Figure(what, "memory of Python", share, MEMORY, peaks[-1], "MB"))
    return Result(figures, [Table("Large linear boards", ("", "processor, s", "MB"), rows)])


def seconds(what: str, found: list[float], baseline: list[float], wanted: float) -> Figure:
    """Return the figure of times, s, over those of the imports."""
    return Figure(what, IMPORTS, ratios(found, baseline), wanted, statistics.median(found), "s")


def processor(job: Callable[[], object]) -> Callable[[], float]:
    """Return a function that runs `job` and returns its processor time, s."""

    def timed() -> float:
        begun = time.process_time()
        job()
        return time.process_time() - begun

    return timed
