"""Compare the stated uncertainties of random verifications with their true errors.

    python scripts/coverage_study.py [--scenes 500] [--first 0] [--engine NAME] [--cache FOLDER]

Every scene has a random ``analysis.error`` (1e-6 to 0.1) or number of points a period (8 to 500),
and runs on both engines. The truth of a linear board is that of the tests' oracle, from the deck's
text. SciPy's integrators are too slow for hundreds of boards with behavioural amplifiers: their
truth is a run of the state-space engine with a tolerance of 1e-11, read at dense instants. Prints,
for every engine, kind of board and reading: the share of readings whose true value is within the
stated uncertainty, and the median of uncertainty over true error. A linear board by the state-space
engine is compared at both levels of its readings: as its checks need them, and "finest", where
only rounding is left. Needs the extra ``dev``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from taction.netlist_gen.scene.scene import Scene  # noqa: E402
from taction.system.errors import TactionError  # noqa: E402
from taction.verification.evidence.stress.compare import TruthComparison, compare  # noqa: E402
from taction.verification.evidence.stress.true_values import TrueValues  # noqa: E402
from taction.verification.verdict.recording import finest  # noqa: E402
from taction.verification.verdict.verify import Verdict, verify  # noqa: E402
from tests.support.fine_readings import fine_readings  # noqa: E402
from tests.support.random_scenes import AMPLIFIERS, random_scene, random_setting  # noqa: E402
from tests.support.true_values import true_values  # noqa: E402

ENGINES = ("ngspice", "statespace")
TIMEOUT = 5.0  # s: longer runs of ngspice are left out


def main() -> int:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--engine", choices=ENGINES, action="append")
    parser.add_argument("--amplifier", choices=AMPLIFIERS, action="append")
    parser.add_argument("--cache", type=Path, help="folder of true values")
    asked = parser.parse_args()
    found: dict[tuple[str, str, str], list[TruthComparison]] = defaultdict(list)
    kinds = asked.amplifier or AMPLIFIERS
    for seed in range(asked.first, asked.first + asked.scenes):
        kind = kinds[seed % len(kinds)]
        try:
            scene = random_scene(seed, kind, timeout=TIMEOUT, **random_setting(seed))
            truth = _truth(scene, seed, kind, asked.cache)
        except (TactionError, AssertionError, ArithmeticError, ValueError) as error:
            print(f"{seed} {kind}: no truth: {str(error)[:100]!r}", flush=True)
            continue
        for engine in asked.engine or ENGINES:
            _run(scene, seed, engine, truth, found)
    for (engine, kind, name), comparisons in sorted(found.items()):
        print(f"{engine:18} {kind:9} {name:13} {_summary(comparisons)}")
    for engine in sorted({key[0] for key in found}):
        every = [c for key, each in found.items() if key[0] == engine for c in each]
        print(engine, _summary(every))
    return 0


def _truth(scene: Scene, seed: int, kind: str, cache: Path | None) -> TrueValues:
    compute = true_values if kind == "linear" else fine_readings
    if cache is None:
        return compute(scene)
    path = cache / f"{kind}-{seed}.json"
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(compute(scene).record()), encoding="utf-8")
    return TrueValues.from_record(json.loads(path.read_text("utf-8")))


def _run(
    scene: Scene,
    seed: int,
    engine: str,
    truth: TrueValues,
    found: dict[tuple[str, str, str], list[TruthComparison]],
) -> None:
    try:
        verdict = verify(scene.with_engine(engine))
    except TactionError as error:
        print(f"{seed} {engine}: {str(error)[:100]!r}", flush=True)
        return
    _compare(verdict, seed, engine, truth, found)
    if verdict.evidence.forever:
        measured, errors = finest(verdict.recording, verdict.ideal)
        recording = replace(verdict.recording, measurements=measured, error=errors)
        finer = replace(verdict, recording=recording)
        _compare(finer, seed, f"{engine}, finest", truth, found)


def _compare(
    verdict: Verdict,
    seed: int,
    engine: str,
    truth: TrueValues,
    found: dict[tuple[str, str, str], list[TruthComparison]],
) -> None:
    scene = verdict.scene
    kind = "linear" if scene.design.amplifier == "linear" else "amplified"
    for comparison in compare(verdict, truth):
        name = comparison.name.split(" ")[0]
        if comparison.error != comparison.error or np.isinf(comparison.uncertainty):
            name = f"{name}?"
        found[engine, kind, name].append(comparison)
        if comparison.wrong:
            print(f"{seed} {scene.design.amplifier} {engine} {comparison}", flush=True)


def _summary(comparisons: list[TruthComparison]) -> str:
    known = [c for c in comparisons if c.error > 2.0 * c.doubt and np.isfinite(c.uncertainty)]
    ratios = [c.uncertainty / c.error for c in known if c.error > 0.0]
    wrong = sum(c.wrong for c in comparisons)
    median = f"{np.median(ratios):.3g}" if ratios else "-"
    return f"{len(comparisons) - wrong}/{len(comparisons)} covered, median ratio {median}"


if __name__ == "__main__":
    sys.exit(main())
