"""The pages of a reproduction, and the command."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from taction.system.charts import Axis, Curve
from taction.system.documents import plain
from taction.verification.evidence.paper import reproduce
from taction.verification.evidence.paper.findings import Chapter, Finding, load_claims
from taction.verification.evidence.paper.pictures import Picture, level, panel
from taction.verification.report.views.paper import write_paper

PNG = b"\x89PNG\r\n"
PICTURE = Picture(
    "a-picture",
    "What <is> seen | here.",
    (
        panel(
            "title",
            Axis("x", scale="log"),
            Axis("y"),
            Curve([1, 2], [3, 4], "line"),
            level(3.5, "mark"),
        ),
    ),
)


def chapter(quick: bool) -> Chapter:
    wanted = [claim for claim in load_claims() if claim.chapter == "reconstruction"]
    found = (Finding(c.id, "run", "a | b <c>", c.expected, {"value": 1.0}) for c in wanted)
    return Chapter(tuple(found), (PICTURE,))


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """One chapter that costs nothing."""
    monkeypatch.setattr(reproduce, "CHAPTERS", {"reconstruction": ("A <title>", chapter)})


@pytest.mark.usefixtures("short")
def test_the_pages_hold_every_claim_and_their_pictures(tmp_path: Path) -> None:
    found = reproduce.reproduce()
    names = write_paper(found, str(tmp_path))
    assert set(names) == {path.name for path in tmp_path.iterdir()}
    html, markdown = ((tmp_path / name).read_text("utf-8") for name in ("paper.html", "paper.md"))
    assert html.count("a | b &lt;c&gt;") == len(found.judged) == markdown.count("a \\| b \\<c\\>")
    assert (tmp_path / "a-picture.png").read_bytes().startswith(PNG)
    assert html.count('class="canvas"') == len(PICTURE.charts)
    assert "What &lt;is&gt; seen | here." in html
    assert re.findall(r'(?:src|href)="(?!#)', html) == []
    assert "A &lt;title&gt;" in html
    assert "(a-picture.png)" in markdown
    assert "mark: 3.5" in html


@pytest.mark.usefixtures("short")
def test_without_the_packages_there_is_a_page_without_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert write_paper(reproduce.reproduce(), str(tmp_path)) == ("paper.md",)
    assert "![" not in (tmp_path / "paper.md").read_text("utf-8")


@pytest.mark.usefixtures("short")
def test_the_document_names_verdict_and_expectation() -> None:
    found = plain(reproduce.reproduce(quick=True))
    assert found["quick"] is True
    assert all(each["as_expected"] for each in found["claims"])
