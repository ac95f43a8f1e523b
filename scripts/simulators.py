"""Verify the shipped scenes with each ngspice, matrix solver and integration method.

    python scripts/simulators.py [--jobs N] [--all] [NGSPICE ...]

The executables follow the installed one; the outcome of every scene must be the same everywhere.
Without `--all` a scene runs with each executable, solver and method once: an executable's first
solver integrates by the trapezoidal rule, its last by Gear's method.
A scene that fixes its number of points in a period gets twice as many for Gear's method, whose
error at the same step is two to four times that of the trapezoidal rule.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

METHODS = ("trapezoidal", "gear")
MORE = 2.0  # times the points of a scene that fixes them, for Gear's method


@dataclass(frozen=True)
class Job:
    """One verification."""

    scene: str
    executable: str | None  # None: the installed one
    klu: bool
    method: str


@dataclass(frozen=True)
class Result:
    """What one verification says."""

    scene: str
    simulator: str
    outcome: str
    failed: str  # the first check that does not pass
    seconds: float


def run(job: Job) -> Result:
    """Verify a scene as `job` asks."""
    from taction.netlist_gen.scene.loading import load_scene
    from taction.verification.engines.ngspice.executable import find_simulator
    from taction.verification.verdict import simulation
    from taction.verification.verdict.verify import verify

    began = time.monotonic()
    scene = load_scene(ROOT / "scenes" / f"{job.scene}.toml").with_engine("ngspice")
    points = scene.analysis.points_per_period
    if job.method == "gear" and points is not None:
        analysis = scene.analysis.model_copy(update={"points_per_period": MORE * points})
        scene = scene.model_copy(update={"analysis": analysis})
    simulator = replace(find_simulator(job.executable), klu=job.klu)
    usual = simulation.ENGINES["ngspice"]

    def begin(design):  # type: ignore[no-untyped-def]
        transient = replace(design.plan.transient, method=job.method)
        return usual.begin(replace(design, plan=replace(design.plan, transient=transient)))

    simulation.find_simulator = lambda: simulator  # type: ignore[attr-defined]
    simulation.OWN["ngspice"] = replace(usual, begin=begin)
    try:
        verdict = verify(scene)
    finally:
        simulation.find_simulator = find_simulator  # type: ignore[attr-defined]
        simulation.OWN["ngspice"] = usual
    failed = (f"{c.name}: {c.reason}" for c in verdict.checks if c.outcome.value != "pass")
    seconds = time.monotonic() - began
    name = verdict.waveforms.simulator
    return Result(job.scene, name, verdict.outcome.value, next(failed, ""), seconds)


def jobs(executables: list[str | None], everything: bool) -> Iterator[Job]:
    """Yield the combinations; an ngspice without KLU has only its own solver."""
    from taction.verification.engines.ngspice.executable import find_simulator

    for scene in sorted(file.stem for file in (ROOT / "scenes").glob("*.toml")):
        for executable in executables:
            solvers = sorted({find_simulator(executable).klu, False}, reverse=True)
            some = {(solvers[0], METHODS[0]), (solvers[-1], METHODS[-1])}
            for klu, method in product(solvers, METHODS):
                if everything or (klu, method) in some:
                    yield Job(scene, executable, klu, method)


def main() -> int:
    """Run all combinations; 1 if two outcomes of a scene differ, or a name is missing."""
    from taction.system.errors import SimulatorNotFound

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--all", action="store_true", help="every combination")
    parser.add_argument("ngspice", nargs="*", help="executables beside the installed one")
    asked = parser.parse_args()
    began = time.monotonic()
    try:
        wanted = list(jobs([None, *asked.ngspice], asked.all))
    except SimulatorNotFound as error:
        print(error, file=sys.stderr)
        return 1
    with ProcessPoolExecutor(asked.jobs) as pool:
        results = list(pool.map(run, wanted))
    failed = 0
    for job, result in zip(wanted, results, strict=True):
        solver = "KLU" if job.klu else "Sparse"
        named = result.simulator.endswith(f", {solver}, {job.method}")
        first = next(other for other in results if other.scene == result.scene)
        wrong = not named or result.outcome != first.outcome
        failed += wrong
        text = f"{result.scene:24} {result.simulator:32} {result.outcome:12}"
        print(f"{text} {result.seconds:5.1f} s  {'DIFFERS ' if wrong else ''}{result.failed}")
    scenes, kinds = len({r.scene for r in results}), len({r.simulator for r in results})
    print(
        f"{scenes} scenes, {kinds} combinations of simulator, solver and method,"
        f" {failed} different outcomes, {time.monotonic() - began:.0f} s"
    )
    return int(failed > 0 or not results)


if __name__ == "__main__":
    sys.exit(main())
