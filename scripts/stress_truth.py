"""Compute the true values of the stress cases, and measure how long their runs take.

    python scripts/stress_truth.py [NAME ...] [--again]

Names are those of cases or families; without names, all cases. Only cases whose tables or deck have
changed since their values were stored are computed, with --again the others, too. The oracle is
that of the tests (`tests/support/true_values.py`); it needs the packages of the extra ``dev``.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from taction.verification.evidence.stress.catalogue import (  # noqa: E402
    TRUE_VALUES,
    Case,
    load_catalogue,
    select,
)
from taction.verification.evidence.stress.run_cases import run_case  # noqa: E402
from tests.support.true_values import deck_digest, true_values  # noqa: E402


def main() -> int:
    """Compute or measure, and write the file after every case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--again", action="store_true", help="compute stored values, too")
    asked = parser.parse_args()
    cases = load_catalogue()
    for case in select(cases, tuple(asked.names)):
        record = _stored().get(case.name)
        if not asked.again and not _stale(case, record):
            continue
        truth = None if case.refused else asdict(true_values(case.scene()))
        seconds = {engine: round(run_case(case, engine).seconds, 2) for engine in case.outcome}
        deck = deck_digest(case)
        record = {"tables": case.digest, "deck": deck, "truth": truth, "seconds": seconds}
        print(f"{case.name}: {record}"[:200], flush=True)
        stored = _stored() | {case.name: record}  # another process may have written, too
        ordered = {c.name: stored[c.name] for c in cases if c.name in stored}
        TRUE_VALUES.write_text(json.dumps(ordered, indent=1) + "\n", encoding="utf-8")
    return 0


def _stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(TRUE_VALUES.read_text("utf-8"))
    return found


def _stale(case: Case, record: dict[str, Any] | None) -> bool:
    """Whether the stored values are missing, or those of other tables or of another deck."""
    if record is None or (record["truth"] is None) != case.refused:
        return True
    return (record["tables"], record["deck"]) != (case.digest, deck_digest(case))


if __name__ == "__main__":
    sys.exit(main())
