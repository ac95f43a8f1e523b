"""Table of planted faults in docs/verdict.md; ``python -m tests.mutation.table`` writes it."""

from __future__ import annotations

import re

from taction.verification.verdict.checks import Outcome
from tests.mutation.catalogue import MUTATIONS
from tests.support.paths import ROOT

PAGE = ROOT / "docs" / "verdict.md"
TABLE = re.compile(r"(<!-- planted faults -->\n).*(<!-- end -->\n)", re.DOTALL)
ENGINES = {"statespace": "state space", "ngspice": "ngspice"}


def page_with(text: str) -> str:
    """Return the page `text` with the table of the catalogue in the place of its own."""
    lines = ["| fault | planted in | scene, engine | caught by |", "|---|---|---|---|"]
    for mutation in MUTATIONS:
        caught = ", ".join(name.replace("_", " ") for name in mutation.caught_by)
        caught += "" if mutation.outcome is Outcome.FAIL else f" ({mutation.outcome.value})"
        verified = f"`{mutation.scene}`, {ENGINES[mutation.engine]}"
        lines.append(f"| {mutation.fault} | {mutation.where} | {verified} | {caught} |")
    table = "\n".join(lines) + "\n"
    return TABLE.sub(lambda found: found[1] + table + found[2], text)


if __name__ == "__main__":
    PAGE.write_text(page_with(PAGE.read_text("utf-8")), encoding="utf-8")
