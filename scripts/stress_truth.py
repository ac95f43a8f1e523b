"""Compute the true values of the stress cases and the times of their runs.

    python scripts/stress_truth.py [NAME ...] [--again]

Names are those of cases or families; without names, all cases. Only cases whose tables have changed
since their values were stored are computed, with --again the others, too. The oracle is
that of the tests (`tests/support/true_readings.py`); it needs the packages of the extra ``dev``.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from spice_models.errors import TactionError  # noqa: E402
from tests.support.true_values import true_values  # noqa: E402
from verification.studies.stress.catalogue import (  # noqa: E402
    FOLDER,
    TRUE_VALUES,
    Case,
    load_catalogue,
    select,
)
from verification.studies.stress.run import run_case  # noqa: E402


def main() -> int:
    """Compute what is asked for and write the file after every case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--again", action="store_true", help="compute stored values, too")
    asked = parser.parse_args()
    path, cases = FOLDER / TRUE_VALUES, load_catalogue()
    stored: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    for case in select(cases, tuple(asked.names)):
        if asked.again or _stale(case, stored):
            stored[case.name] = _record(case)
            print(f"{case.name}: {stored[case.name]}"[:200], flush=True)
            ordered = {c.name: stored[c.name] for c in cases if c.name in stored}
            path.write_text(json.dumps(ordered, indent=1) + "\n", encoding="utf-8")
    return 0


def _stale(case: Case, stored: dict[str, Any]) -> bool:
    return case.name not in stored or stored[case.name]["tables"] != case.digest


def _record(case: Case) -> dict[str, Any]:
    try:
        truth = true_values(case.scene()).record()
    except TactionError:
        truth = None
    seconds = {engine: round(run_case(case, engine).seconds, 2) for engine in case.engines}
    return {"tables": case.digest, "truth": truth, "seconds": seconds}


if __name__ == "__main__":
    sys.exit(main())
