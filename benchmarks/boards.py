"""Larger boards: whole `verify` commands, with wall time and peak memory."""

from __future__ import annotations

import statistics
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks.bare import cheapest, process_seconds, true_solution
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
from taction.netlist_gen.scene.loading import load_scene
from taction.system.progress import Clock
from taction.verification.verdict.design import design_board

SCENE = """
name = "larger-board"
[problem]
kind = "tactile"
channels = {channels}
span = 16.0
quadrature = "rectangle"
[design]
amplifier = "{amplifier}"
capacitance = "220pF"
gain = "500kohm"
unit_conductance = "2uS"
lambda = 0.1
opamp = {{ base = "tl084", input_errors = "none" }}
stray_capacitance = "2pF"
[checks]
steady_state = {{ tolerance = 1e-2 }}
"""
IMPORTS = "import of scipy.linalg and pydantic"
MEMORY = 1000.0  # MB, wanted for every command
TIMES = 3.0  # wanted: a command by ngspice over the cheapest bare run, where no time is wanted
TIMEOUT = 600.0  # s


@dataclass(frozen=True)
class Job:
    """A board, an engine, the wanted wall time in s if there is one, and how often it runs."""

    channels: int
    amplifier: str
    engine: str
    wanted: float | None = None
    rounds: int = 3

    @property
    def name(self) -> str:
        """In words."""
        return f"verify, {self.channels} channels, {self.amplifier}, {self.engine}"

    def write(self, folder: Path) -> Path:
        """Write the scene and return its path."""
        path = folder / f"{self.channels}-{self.amplifier}.toml"
        path.write_text(SCENE.format(channels=self.channels, amplifier=self.amplifier))
        return path

    def run(self, folder: Path) -> Cost:
        """Run the whole command."""
        return taction("verify", str(self.write(folder)), "--engine", self.engine)


QUICK = (
    Job(64, "linear", "statespace", 1.5),
    Job(64, "linear", "ngspice", 12.0),
    Job(64, "exponential", "statespace", 5.0),
    Job(64, "exponential", "ngspice"),
    Job(200, "linear", "statespace", 3.5),
)
JOBS = {
    Extent.TINY: (Job(3, "linear", "ngspice", rounds=1),),
    Extent.QUICK: QUICK,
    Extent.FULL: (
        *QUICK,
        Job(200, "linear", "ngspice", rounds=1),
        Job(200, "exponential", "statespace", 40.0, rounds=1),
        Job(200, "exponential", "ngspice", rounds=1),
    ),
}


def measure(extent: Extent) -> Result:
    """Run every command in turns with the imports that every command needs."""
    figures, rows, peaks = [], [], []
    with tempfile.TemporaryDirectory() as place:
        for job in JOBS[extent]:
            runs = {IMPORTS: partial(python, "import scipy.linalg, pydantic")}
            runs |= {job.name: partial(job.run, Path(place))}
            found = in_turns(runs, job.rounds, warm=False)
            clock = {name: [cost.wall for cost in costs] for name, costs in found.items()}
            seconds = statistics.median(clock[job.name])
            peaks.append(max(cost.memory for cost in found[job.name]))
            times = ratios(clock[job.name], clock[IMPORTS])
            figures.append(Figure(job.name, IMPORTS, times, job.wanted, seconds, "s"))
            rows.append((job.name, f"{seconds:.2f}", f"{peaks[-1]:.0f}"))
        if extent is not Extent.QUICK:
            figures += [
                f for job in JOBS[extent] if bare_known(job) for f in over_bare(job, Path(place))
            ]
    python_alone = python("").memory
    share = [peak / python_alone for peak in peaks]
    what = "peak memory of the largest of these"
    figures.append(Figure(what, "memory of Python", share, MEMORY, max(peaks), "MB"))
    return Result(figures, [Table("Larger boards", ("", "wall, s", "memory, MB"), rows)])


def bare_known(job: Job) -> bool:
    """Whether a ladder of bare runs of the board takes minutes, not hours."""
    return job.engine == "ngspice" and job.channels <= 64


def over_bare(job: Job, folder: Path) -> list[Figure]:
    """Compare a command with the cheapest bare ngspice whose error the scene allows, if any."""
    scene = load_scene(job.write(folder))
    design = design_board(scene.with_engine("ngspice"), Clock(lambda stage: None))
    truth = true_solution(design.board, design.transient)
    best = cheapest(design.board, design.transient, truth, design.plan.wanted, TIMEOUT)
    if best is None:
        return []
    deck = best.deck
    runs = {"verify": lambda: job.run(folder).wall, "bare": lambda: process_seconds(deck)}
    found = in_turns(runs, job.rounds, warm=False)
    wanted = None if job.wanted else TIMES
    base = "cheapest bare ngspice of the same error"
    return [Figure(job.name, base, ratios(found["verify"], found["bare"]), wanted)]
