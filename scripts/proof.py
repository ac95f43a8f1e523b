"""Prove that a change leaves all verdicts as they are, and all readings within their bounds.

    python scripts/proof.py [PART ...]            all parts, or these; status 1 if one is red
    python scripts/proof.py --update [PART ...]   store what is found now as what is expected

The parts: the shipped scenes against their baseline, the stress catalogue against its true values,
random scenes and random decks against stored outcomes and readings, the coverage of the stated
bounds against stored true values, and planted faults. `tests/data/proof.json.gz` holds what is
expected. Two numbers agree if they differ by no more than the sum of their bounds.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import taction  # noqa: E402
from taction.system.documents import read  # noqa: E402
from taction.verification.evidence.stress.catalogue import TrueValues  # noqa: E402
from taction.verification.evidence.stress.run_cases import compare  # noqa: E402
from tests.support import designer_decks, random_circuits, random_scenes  # noqa: E402
from tests.support.true_values import true_values  # noqa: E402

STORE = ROOT / "tests" / "data" / "proof.json.gz"
SCENES, COVERED, CIRCUITS = 200, 200, 230
TIMEOUT = 5.0  # s: a longer run of ngspice is no part of the coverage
ROUNDING = 1e-9  # relative: two numbers that differ by less are the same
Found = dict[str, Any]
Number = list[float]  # value and bound


def number(value: Any) -> Number | None:
    """Return value and bound of a reading, or None where there is none."""
    if value is None or not math.isfinite(value.value):
        return None
    return [float(value.value), float(value.uncertainty)]


def of_scene(seed: int) -> Found:
    """Return outcome, checks and readings of a random scene."""
    scene = random_scenes.scene_of_any_kind(seed)
    try:
        verdict = taction.verify(scene)
    except taction.TactionError as error:
        return {"outcome": type(error).__name__}
    checks = {check.name: check.outcome.value for check in verdict.checks}
    numbers = {
        f"{name} {n}": number(reading)
        for n, channel in enumerate(verdict.measurements.channels)
        for name, reading in channel.readings.items()
    }
    return {"outcome": verdict.outcome.value, "checks": checks, "numbers": numbers}


def of_deck(seed: int) -> Found:
    """Return stability, rightmost pole and readings of a designer's deck, or of a random one."""
    own, random = [*designer_decks.DECKS.values()], random_circuits.random_cards(seed)
    text = own[seed] if seed < len(own) else "\n".join(("random", *random, ".end\n"))
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "deck.cir"
        place.write_text(text, encoding="utf-8")
        try:
            found = taction.check(place, ngspice=False)
        except taction.TactionError as error:
            return {"outcome": type(error).__name__}
    numbers: dict[str, Number | None] = {}
    if found.pole_rows:
        lead = found.pole_rows[0]
        numbers["rightmost"] = [lead.real or 0.0, lead.bound or 0.0]
    for n, channel in enumerate(found.measurements.channels):
        numbers |= {f"{name} {n}": number(each) for name, each in channel.readings.items()}
    return {"outcome": found.outcome.value, "numbers": numbers}


def of_coverage(seed: int, truth: Found | None) -> Found:
    """Return the true values of a random scene, and what the verdicts of both engines miss."""
    kind = random_scenes.AMPLIFIERS[seed % len(random_scenes.AMPLIFIERS)]
    setting = random_scenes.random_setting(seed)
    scene = random_scenes.random_scene(seed, kind, timeout=TIMEOUT, **setting)
    if truth is None:
        try:
            truth = asdict(true_values(scene))
        except (taction.TactionError, AssertionError, ArithmeticError, ValueError) as error:
            return {"no truth": str(error)[:100]}
    if "no truth" in truth:
        return truth
    outside, unanswered = [], 0
    for engine in ("ngspice", "statespace"):
        try:
            verdict = taction.verify(scene.with_engine(engine))
        except taction.TactionError:
            unanswered += 1
            continue
        numbers = compare(verdict, read(TrueValues, truth))
        outside += [f"{engine}: {each}" for each in numbers if each.wrong]
    return {"truth": truth, "outside": outside, "unanswered": unanswered}


def known(found: Number | None) -> Number | None:
    """Return a number, or None where its bound is infinite: then it says nothing."""
    return found if found is not None and math.isfinite(found[1]) else None


def differences(old: Found, new: Found) -> Iterator[str]:
    """Yield what differs between two results by more than their bounds."""
    for name in ("outcome", "checks"):
        if old.get(name) != new.get(name):
            yield f"{name}: {old.get(name)} -> {new.get(name)}"
    a, b = old.get("numbers", {}), new.get("numbers", {})
    for name in sorted(a.keys() | b.keys()):
        one, other = known(a.get(name)), known(b.get(name))
        if one is None or other is None:
            if one is not other:
                yield f"{name}: {one} -> {other}"
        elif not abs(one[0] - other[0]) <= one[1] + other[1] + ROUNDING * abs(one[0]):
            yield f"{name}: {one[0]} ± {one[1]} -> {other[0]} ± {other[1]}"


PYTHON = [sys.executable, "-m"]
COMMANDS = {
    "regress": [*PYTHON, "taction", "regress", "scenes/", "--baseline", "scenes/baseline.json"],
    "stress": [*PYTHON, "taction", "self", "stress", "--jobs", "2"],
    "faults": [*PYTHON, "pytest", "-q", "-n", "2", "tests/mutation"],
}
STORED: dict[str, tuple[Callable[[int], Found], int]] = {
    "scenes": (of_scene, SCENES),
    "decks": (of_deck, CIRCUITS + len(designer_decks.DECKS)),
}
PARTS = (*COMMANDS, *STORED, "coverage")


def compare_part(name: str, stored: Found, pool: ProcessPoolExecutor, update: bool) -> list[str]:
    """Return what is wrong in a part; with `update` its results go into `stored` instead."""
    if name in COMMANDS:
        done = subprocess.run(COMMANDS[name], cwd=ROOT, capture_output=True, text=True)
        return [(done.stdout + done.stderr)[-2000:]] if done.returncode else []
    old: list[Found] = stored.get(name, [])
    if name == "coverage":
        truths = [None] * COVERED if update or not old else old
        new = list(pool.map(of_coverage, range(COVERED), truths, chunksize=4))
        stored[name] = [each.get("truth", each) for each in new]
        print(f"  {sum(each.get('unanswered', 0) for each in new)} without a verdict", flush=True)
        return [f"{n} {text}" for n, each in enumerate(new) for text in each.get("outside", ())]
    job, count = STORED[name]
    new = list(pool.map(job, range(count), chunksize=4))
    print(f"  {dict(Counter(each['outcome'] for each in new))}", flush=True)
    if update:
        stored[name] = new
        return []
    pairs = zip(old, new, strict=True)
    return [f"{n} {text}" for n, pair in enumerate(pairs) for text in differences(*pair)]


def main() -> int:
    """Run the parts; 1 if one is red."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", choices=PARTS, metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--update", action="store_true")
    asked = parser.parse_args()
    stored = json.loads(gzip.decompress(STORE.read_bytes())) if STORE.exists() else {}
    red = []
    with ProcessPoolExecutor(2) as pool:
        for name in asked.parts or PARTS:
            began = time.monotonic()
            wrong = compare_part(name, stored, pool, asked.update)
            for text in wrong[:20]:
                print(f"  {text}")
            red += [name] if wrong else []
            state = f"{len(wrong)} wrong" if wrong else "green"
            print(f"{name}: {state}, {time.monotonic() - began:.0f} s", flush=True)
    if asked.update:
        text = json.dumps(stored, separators=(",", ":"))
        STORE.write_bytes(gzip.compress(text.encode(), mtime=0))
    return int(bool(red))


if __name__ == "__main__":
    sys.exit(main())
