"""The error budget of a report: the parts, their sum and the whole difference."""

from __future__ import annotations

import taction
from tests.support.paths import SCENES
from verification.report.html.blocks import Picture, Table
from verification.report.html.sections.errors import budget_section
from verification.report.verdict.json_document import verdict_document


def test_the_table_ends_with_the_sum_and_the_whole_difference() -> None:
    verdict = taction.verify(SCENES / "custom-matrix.toml", engine="statespace")
    document = verdict_document(verdict)
    picture, table = budget_section(document).blocks
    assert isinstance(picture, Picture)
    assert isinstance(table, Table)
    names = [row[0].text for row in table.rows]
    assert names[-2:] == ["sum of the parts", document["error_budget"]["total"]["how"]]
    assert "total" not in names
    signed = {row[0].text: row[3].number for row in table.rows}
    total = document["error_budget"]["total"]["channels"]
    assert signed[names[-1]] == max(total, key=abs)
    parts = [number for name, number in signed.items() if name in names[:-2]]
    assert abs(sum(filter(None, parts)) / max(total, key=abs) - 1.0) < 0.01
    bars = [name for trace in picture.spec["data"] for name in trace["x"]]
    assert "ill posedness" in bars
    assert "total" not in bars
