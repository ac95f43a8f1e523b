"""What a user waits for: the start of the command, a refusal, and whole verdicts."""

from __future__ import annotations

from benchmarks.measuring import IMPORTS, SCENES, Figure, imports, in_turns, python, ratios, taction

DAMPED = str(SCENES / "tuned-breadboard.toml")
NOTHING = "a Python that does nothing"
SECONDS = {"taction --help": 0.15, "a refused scene": 0.8}  # wanted, wall time
RATIO = 2.2  # wanted of a whole verify, over the imports


def measure(tiny: bool) -> list[Figure]:
    """Time processes from their start to their end."""
    jobs = {
        NOTHING: lambda: python(""),
        "taction --help": lambda: taction("--help"),
        "a refused scene": lambda: taction("verify", DAMPED, "--set", "gain=-1"),
        IMPORTS: imports,
        "whole verify by ngspice": lambda: taction("verify", DAMPED, "--engine", "ngspice"),
        "whole verify by state space": lambda: taction("verify", DAMPED, "--engine", "statespace"),
    }
    found = in_turns(jobs, 1 if tiny else 7, warm=not tiny)
    wall = {name: [cost.wall for cost in costs] for name, costs in found.items()}
    figures = []
    for name, wanted in SECONDS.items():
        seconds = sorted(wall[name])[len(wall[name]) // 2]
        share = ratios(wall[name], wall[NOTHING])
        figures.append(Figure(name, NOTHING, share, wanted, seconds, "s"))
    for name in list(jobs)[-2:]:
        share = ratios(wall[name], wall[IMPORTS])
        figures.append(Figure(f"{name}, damped board", IMPORTS, share, RATIO))
    return figures
