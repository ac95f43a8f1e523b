"""Table of planted faults in docs/witnesses.md; ``python -m tests.mutation.table`` writes it."""

from __future__ import annotations

from taction.verification.verdict.checks import Outcome
from tests.mutation.catalogue import MUTATIONS
from tests.mutation.judging import MISJUDGEMENTS
from tests.support.paths import ROOT

PAGE = ROOT / "docs" / "witnesses.md"
ENGINES = {"statespace": "state space", "ngspice": "ngspice"}


def page_with(text: str) -> str:
    """Return the page `text` with the tables of both catalogues in the place of its own."""
    lines = ["| fault | planted in | scene, engine | caught by |", "|---|---|---|---|"]
    for mutation in MUTATIONS:
        caught = ", ".join(name.replace("_", " ") for name in mutation.caught_by)
        caught += "" if mutation.outcome is Outcome.FAIL else f" ({mutation.outcome.value})"
        verified = f"`{mutation.scene}`, {ENGINES[mutation.engine]}"
        lines.append(f"| {mutation.fault} | {mutation.where} | {verified} | {caught} |")
    judged = [
        "| fault | planted in | board that must not pass | right result |",
        "|---|---|---|---|",
    ]
    for each in MISJUDGEMENTS:
        right = f"{each.caught_by.replace('_', ' ')}: {each.right}"
        judged.append(f"| {each.fault} | {each.where} | {each.board} | {right} |")
    for name, table in (("planted faults", lines), ("faults of the judging", judged)):
        made = "\n".join(table) + "\n"
        begin, end = f"<!-- {name} -->\n", "<!-- end -->\n"
        before, _, rest = text.partition(begin)
        text = before + begin + made + end + rest.partition(end)[2]
    return text


if __name__ == "__main__":
    PAGE.write_text(page_with(PAGE.read_text("utf-8")), encoding="utf-8")
