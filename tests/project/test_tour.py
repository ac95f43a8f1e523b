"""The tour of Python: every line gives the output that the page shows; no name is left out."""

from __future__ import annotations

import doctest
import re
import shutil
from pathlib import Path

import pytest

import taction
from taction.verification.report import tool_server
from taction.verification.report.explorer import server
from tests.support.paths import ROOT

PAGE = ROOT / "docs" / "tour.md"
BLOCK = re.compile(r"^```pycon\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CODE = "".join(BLOCK.findall(PAGE.read_text("utf-8")))


def test_every_public_name_is_used() -> None:
    used = set(re.findall(r"\btaction\.(\w+)", CODE))
    assert used == set(taction.__all__)


@pytest.mark.usefixtures("quick_stories")
def test_every_line_gives_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    explored: list[str] = []
    served: list[tuple[str, float]] = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(server, "explore", lambda scene, **_: explored.append(scene.name))
    monkeypatch.setattr(tool_server, "serve", lambda folder, limit: served.append((folder, limit)))
    shutil.copy(ROOT / "tests" / "data" / "fet100.cir", tmp_path)
    examples = doctest.DocTestParser().get_doctest(CODE, {}, PAGE.name, str(PAGE), 0)
    found = doctest.DocTestRunner().run(examples)
    assert found.attempted > 50
    assert not found.failed
    assert explored == ["tour"]
    assert served == [("boards", 300.0)]
