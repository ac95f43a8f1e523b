"""``taction verify`` with several scenes and folders."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.support.entries import write_fast
from tests.support.running import document, taction

VARYING = ("timing", "simulation", "accuracy", "taction")  # wall times, and the head


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One scene that passes, one that fails, one that is no scene."""
    write_fast(tmp_path / "good.toml")
    write_fast(tmp_path / "slow.toml", limit="1us")
    (tmp_path / "draft-1.toml").write_text("[problem]\nkind = 'tactil'\n")
    return tmp_path


def test_the_table_has_a_row_for_each_scene_and_the_reasons_below(folder: Path) -> None:
    result = taction("verify", str(folder), "--exclude", "draft-*", "--jobs", "1")
    assert result.exit_code == 1
    assert f"{folder}/good.toml" in result.stdout
    assert "settles to ±1 % in " in result.stdout
    assert "2 scenes: 1 pass, 1 fail" in result.stdout


def test_one_document_holds_the_documents_of_single_runs(folder: Path) -> None:
    good, slow = str(folder / "good.toml"), str(folder / "slow.toml")
    whole = document(taction("verify", slow, good, slow, "--json", "--jobs", "1"))
    assert (whole["outcome"], whole["exit_status"], whole["counts"]) == (
        "fail",
        1,
        {"pass": 1, "fail": 1},
    )
    for file, found in zip((slow, good), whole["verdicts"], strict=True):
        single = document(taction("verify", file, "--json", "--changes", "0"))
        same = {key: value for key, value in single.items() if key not in VARYING}
        assert same == {key: value for key, value in found.items() if key not in VARYING}


def test_the_exit_status_is_the_worst_and_a_bad_file_stops_no_other(folder: Path) -> None:
    result = taction("verify", str(folder), "--json", "--jobs", "1")
    assert result.exit_code == 2
    found = json.loads(result.stdout)
    assert found["counts"] == {"pass": 1, "fail": 1, "bad input": 1}
    bad = found["verdicts"][0]
    assert bad["file"].endswith("draft-1.toml")
    assert bad["error"]["complaints"][0]["key"] == "problem.kind"


def test_junit_has_a_suite_for_each_scene(folder: Path) -> None:
    file = folder.parent / f"{folder.name}.xml"
    result = taction("verify", str(folder), "--junit", str(file), "--jobs", "1")
    assert result.exit_code == 2
    root = ET.fromstring(file.read_text(encoding="utf-8"))  # noqa: S314 - our own file
    assert (root.get("failures"), root.get("errors")) == ("1", "1")
    assert [suite.get("name") for suite in root] == ["draft-1", "good", "slow"]


def test_annotations_stand_on_stderr_where_github_runs(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    slow = str(folder / "slow.toml")
    several = taction("verify", slow, str(folder / "good.toml"), "--json", "--jobs", "1")
    alone = taction("verify", slow, "--json", "--changes", "0")
    start = f"::error file={slow},title=taction verify (fail)::settles to ±1 %25 in "
    for result in (several, alone):
        assert any(line.startswith(start) for line in result.stderr.splitlines())
        assert "::error" not in result.stdout
    bad = taction("verify", str(folder / "draft-1.toml"))
    assert "::error file=" in bad.stderr
    table = (str(folder), "--baseline", str(folder.parent / "b.json"), "--jobs", "1")
    failing = taction("regress", *table, "--update")
    found = [line for line in failing.stderr.splitlines() if line.startswith("::")]
    assert any(line.startswith(start.replace("verify (fail)", "regress (new)")) for line in found)
    assert "::" not in taction("regress", *table, "--no-annotate").stderr
    assert bad.exit_code == 2
    assert "::error" not in taction("verify", slow, "--no-annotate", "--changes", "0").stderr


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--exclude", "*.toml"), "leaves no scene"),
        (("--exclude", "typo-*"), "matches no file"),
        (("--plot", "board.png"), "shows one board"),
    ],
)
def test_options_that_cannot_be_used_are_refused(
    folder: Path, words: tuple[str, ...], text: str
) -> None:
    result = taction("verify", str(folder), *words)
    assert result.exit_code == 2
    assert text in result.stderr
