"""What the command costs: its start, a whole `verify`, and `verify` beside a bare ngspice."""

from __future__ import annotations

import statistics
from pathlib import Path

from benchmarks.bare import process_seconds, solver
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
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.verification.reference.ideal_answer import ideal_answer, ideal_network
from taction.verification.verdict.verify import Verdict, verify

ROUNDS = {Extent.TINY: 1, Extent.QUICK: 7, Extent.FULL: 20}
DAMPED, RINGING = SCENES / "tuned-breadboard.toml", SCENES / "paper-breadboard.toml"
IMPORTS, NOTHING = "import of scipy.linalg and pydantic", "a Python that does nothing"


def measure(extent: Extent) -> Result:
    """Measure whole commands, then `verify` inside this process."""
    tiny, rounds = extent is Extent.TINY, ROUNDS[extent]
    commands = whole_commands(rounds, warm=not tiny)
    overhead = beside_ngspice(DAMPED if tiny else RINGING, rounds)
    return Result(commands.figures + overhead.figures, commands.tables + overhead.tables)


def whole_commands(rounds: int, *, warm: bool) -> Result:
    """Time processes from their start to their end."""
    jobs = {
        NOTHING: lambda: python(""),
        "taction --help": lambda: taction("--help"),
        IMPORTS: lambda: python("import scipy.linalg, pydantic"),
        "verify by ngspice": lambda: taction("verify", str(DAMPED), "--engine", "ngspice"),
        "verify by state space": lambda: taction("verify", str(DAMPED), "--engine", "statespace"),
    }
    costs = in_turns(jobs, rounds, warm=warm)
    clock = {name: [cost.wall for cost in found] for name, found in costs.items()}
    figures = [
        Figure("taction --help", NOTHING, ratios(clock["taction --help"], clock[NOTHING])),
        *(
            Figure(f"whole {job}, damped board", IMPORTS, ratios(clock[job], clock[IMPORTS]), 2.5)
            for job in ("verify by ngspice", "verify by state space")
        ),
    ]
    rows = [(name, *_medians(found)) for name, found in costs.items()]
    return Result(figures, [Table("Whole commands", ("", "wall, s", "processor, s", "MB"), rows)])


def _medians(costs: list[Cost]) -> tuple[str, str, str]:
    median = statistics.median
    seconds = median(cost.wall for cost in costs), median(cost.processor for cost in costs)
    return f"{seconds[0]:.2f}", f"{seconds[1]:.2f}", f"{max(cost.memory for cost in costs):.0f}"


def beside_ngspice(file: Path, rounds: int) -> Result:
    """Time `verify` and a bare ngspice on the same deck; the reference solution stands apart."""
    scene = load_scene(file)
    network = ideal_network(make_problem(scene), scene)
    verdicts: list[Verdict] = [verify(scene)]
    deck = write_deck(verdicts[0].circuit, verdicts[0].transient, solver=solver())
    jobs = {
        "ngspice": lambda: process_seconds(deck),
        "verify": wall(lambda: verdicts.append(verify(scene))),
        "reference": wall(lambda: ideal_answer(network, scene)),
    }
    found = in_turns(jobs, rounds)
    beyond = [a - b for a, b in zip(found["verify"], found["reference"], strict=True)]
    what, base = f"verify less the reference solution, {scene.name}", "bare ngspice, the same deck"
    stages = {stage: [v.timing[stage] for v in verdicts] for stage in verdicts[0].timing}
    rows = [(stage, f"{1e3 * statistics.median(each):.1f}") for stage, each in stages.items()]
    title = f"Stages of verify, {scene.name}; simulation is the time of waiting"
    return Result(
        [Figure(what, base, ratios(beyond, found["ngspice"]), 1.25)],
        [Table(title, ("stage", "median, ms"), rows)],
    )
