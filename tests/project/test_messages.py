"""The index of error messages has what taction really says, and says of each kind what to do."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from taction.system import errors
from tests.support.paths import ROOT
from tests.support.running import taction

SCENE = (ROOT / "scenes" / "tuned-breadboard.toml").read_text("utf-8")
MISTAKES = {
    "an unknown key": ("verify", SCENE.replace("channels", "chanels"), ()),
    "a wrong unit": ("verify", SCENE.replace("10pF", "10nH"), ()),
    "no range": ("onset", SCENE, ("--over", "C=1pF")),
    "two meanings": ("sweep", SCENE, ("--over", "C=1pF:9pF:3", "--fix", "C")),
    "no such setting": ("verify", SCENE, ("--set", "C")),
    "a missing file": ("netlist", SCENE, ("--split",)),
}


@pytest.fixture
def index(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs"), *sys.path])
    import messages

    return messages


def test_every_kind_says_what_it_means_and_what_to_do(index: ModuleType) -> None:
    kinds = index.kinds()
    assert list(kinds)[:3] == ["TactionError", "InputError", "NoVerdictError"]
    assert all(issubclass(kind, errors.TactionError) for kind in kinds.values())
    assert len(kinds) == len(re.findall(r"^class \w+\(\w*Error\)", _source(), re.MULTILINE)) + 1
    assert [name for name, kind in kinds.items() if not all(index.said(kind))] == []


def test_the_index_has_most_of_the_places_that_raise(index: ModuleType) -> None:
    found = index.messages()
    places = sum(path.read_text("utf-8").count("Complaint(") for path in index.modules().values())
    assert len([each for each in found if each.kind == "InputError"]) > places
    assert {each.kind for each in found} <= index.kinds().keys()


@pytest.mark.parametrize("name", MISTAKES)
def test_a_message_of_a_real_mistake_is_in_the_index(
    index: ModuleType, name: str, tmp_path: Path
) -> None:
    command, text, options = MISTAKES[name]
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    said = taction(command, str(tmp_path / "a.toml"), *options)
    assert said.exit_code == 2
    words = " ".join(said.stderr.split())
    known = [each.text for each in index.messages() if each.kind == "InputError"]
    longest = max((each for each in known if pattern(index, each).search(words)), key=len)
    assert len(longest) > 15, said.stderr


def pattern(index: ModuleType, text: str) -> re.Pattern[str]:
    return re.compile(".+".join(map(re.escape, text.split(index.OPEN))))


def _source() -> str:
    return (ROOT / "taction" / "system" / "errors.py").read_text("utf-8")
