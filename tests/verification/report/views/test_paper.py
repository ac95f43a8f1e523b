"""The page of a reproduction, and its document."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.system.charts import Axis, Curve, Limit
from taction.system.documents import plain
from taction.verification.evidence.paper import reproduce
from taction.verification.evidence.paper.findings import Chapter, Finding, chart, load_claims

DRAWN = chart(
    "title",
    "What <is> seen | here.",
    Axis("x", scale="log"),
    Axis("y"),
    Curve([1, 2], [3, 4], "line"),
    Limit(3.5, "y", "mark: 3.5"),
)


def chapter(quick: bool) -> Chapter:
    wanted = [claim for claim in load_claims() if claim.chapter == "reconstruction"]
    found = (Finding(c, "run", "a | b <c>", c.expected, {"value": 1.0}) for c in wanted)
    return Chapter(tuple(found), (DRAWN,))


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """One chapter that costs nothing."""
    monkeypatch.setattr(reproduce, "CHAPTERS", {"reconstruction": ("A <title>", chapter)})


@pytest.mark.usefixtures("short")
def test_the_page_holds_every_claim_and_the_pictures(tmp_path: Path) -> None:
    found = reproduce.reproduce()
    found.report(tmp_path / "paper.html")
    html = (tmp_path / "paper.html").read_text("utf-8")
    assert html.count("a | b &lt;c&gt;") == len(found.findings)
    assert html.count('class="canvas"') == 1
    assert "mark: 3.5" in html
    assert "What &lt;is&gt; seen | here." in html
    assert "A &lt;title&gt;" in html


@pytest.mark.usefixtures("short")
def test_the_document_names_verdict_and_expectation() -> None:
    found = plain(reproduce.reproduce(quick=True))
    assert found["quick"] is True
    assert all(each["as_expected"] for each in found["claims"])
