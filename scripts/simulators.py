"""Verify the shipped scenes with each ngspice, matrix solver and integration method.

    python scripts/simulators.py [--jobs N] [--all] [NGSPICE ...]

The executables follow the installed one; the outcome of every scene must be the same everywhere.
Without `--all` a scene runs with each executable once: the installed one's last solver integrates
by Gear's method (`make regress` has its first one and the trapezoidal rule), the first solver of
another one by the trapezoidal rule.
A scene that fixes its number of points in a period gets twice as many for Gear's method, whose
error at the same step is two to four times that of the trapezoidal rule.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from taction.netlist_gen.scene.scene import load_scene  # noqa: E402
from taction.system.errors import SimulatorNotFound  # noqa: E402
from taction.verification.engines.ngspice.process import find_simulator  # noqa: E402
from taction.verification.verdict import simulation  # noqa: E402
from taction.verification.verdict.verify import verify  # noqa: E402

METHODS = ("trapezoidal", "gear")
MORE = 2.0  # times the points of a scene that fixes them, for Gear's method
Job = tuple[str, str | None, bool, str]  # scene, executable (None: the installed), KLU, method


def run(job: Job) -> tuple[str, str, str]:
    """Verify a scene; return what simulated it, the outcome, and the first check that fails."""
    name, executable, klu, method = job
    scene = load_scene(ROOT / "scenes" / f"{name}.toml").with_engine("ngspice")
    points = scene.analysis.points_per_period
    if method == "gear" and points is not None:
        analysis = scene.analysis.model_copy(update={"points_per_period": MORE * points})
        scene = scene.model_copy(update={"analysis": analysis})
    simulator, usual = replace(find_simulator(executable), klu=klu), simulation.OWN["ngspice"]

    def begin(design):  # type: ignore[no-untyped-def]
        transient = replace(design.plan.transient, method=method)
        return usual.begin(replace(design, plan=replace(design.plan, transient=transient)))

    simulation.find_simulator = lambda: simulator  # type: ignore[attr-defined]
    simulation.OWN["ngspice"] = replace(usual, begin=begin)
    try:
        verdict = verify(scene)
    finally:
        simulation.find_simulator = find_simulator  # type: ignore[attr-defined]
        simulation.OWN["ngspice"] = usual
    failed = (f"{c.name}: {c.reason}" for c in verdict.checks if c.outcome.value != "pass")
    return verdict.waveforms.simulator, verdict.outcome.value, next(failed, "")


def jobs(executables: list[str | None], everything: bool) -> Iterator[Job]:
    """Yield the combinations; an ngspice without KLU has only its own solver."""
    for scene, executable in product(sorted((ROOT / "scenes").glob("*.toml")), executables):
        solvers = sorted({find_simulator(executable).klu, False}, reverse=True)
        some = (solvers[0], METHODS[0]) if executable else (solvers[-1], METHODS[-1])
        for klu, method in product(solvers, METHODS) if everything else [some]:
            yield scene.stem, executable, klu, method


def main() -> int:
    """Run all combinations; 1 if two outcomes of a scene differ, or a name is missing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--all", action="store_true", help="every combination")
    parser.add_argument("ngspice", nargs="*", help="executables beside the installed one")
    asked = parser.parse_args()
    try:
        wanted = list(jobs([None, *asked.ngspice], asked.all))
    except SimulatorNotFound as error:
        print(error, file=sys.stderr)
        return 1
    first, wrong = dict[str, str](), 0
    with ProcessPoolExecutor(asked.jobs) as pool:
        for job, (simulator, outcome, failed) in zip(wanted, pool.map(run, wanted), strict=True):
            scene, _, klu, method = job
            named = simulator.endswith(f", {'KLU' if klu else 'Sparse'}, {method}")
            differs = not named or outcome != first.setdefault(scene, outcome)
            wrong += differs
            print(f"{scene:24} {simulator:32} {outcome:12} {'DIFFERS ' * differs}{failed}")
    print(f"{len(wanted)} runs of {len(first)} scenes, {wrong} different outcomes")
    return int(wrong > 0 or not wanted)


if __name__ == "__main__":
    sys.exit(main())
