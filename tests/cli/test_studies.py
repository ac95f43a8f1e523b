"""The commands that verify many boards: several scenes, sweep, stress, regress, and explore."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import jsonschema
import pytest
from click.testing import Result

from taction.verification.report.documents.document_catalogue import schema
from taction.verification.report.explorer import server
from tests.support.entries import write_fast
from tests.support.running import document, taction

VARYING = ("timing", "simulation", "accuracy", "taction")  # wall times, and the head


def regress(*words: object) -> Result:
    return taction("regress", *map(str, words), "--jobs", "1")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes"
    folder.mkdir()
    write_fast(folder / "a.toml")
    assert regress(folder, "--baseline", tmp_path / "b.json", "--update").exit_code == 0
    return folder


def test_a_file_that_is_no_baseline_of_ours_is_never_overwritten(folder: Path) -> None:
    file = folder.parent / "other.json"
    file.write_text('{"a": 1}')
    assert regress(folder, "--baseline", file, "--update").exit_code == 2
    assert file.read_text() == '{"a": 1}'


def test_a_report_that_cannot_be_written_spoils_neither_result_nor_baseline(folder: Path) -> None:
    write_fast(folder / "a.toml", capacitance="10.5pF")
    file = folder.parent / "b.json"
    before = file.read_bytes()
    words = ("--update", "--junit", "/dev/full", "--json")
    result = regress(folder, "--baseline", file, *words)
    assert result.exit_code == 2
    assert "No space left on device" in result.stderr
    assert json.loads(result.stdout)["counts"] == {"changed": 1}
    assert file.read_bytes() != before


@pytest.mark.usefixtures("boards")
def test_one_document_holds_the_documents_of_single_runs() -> None:
    words = ("slow.toml", "a.toml", "slow.toml")
    whole = document(taction("verify", *words, "--json", "--jobs", "1"))
    assert (whole["outcome"], whole["exit_status"]) == ("fail", 1)
    assert whole["counts"] == {"pass": 1, "fail": 1}
    for file, found in zip(words[:2], whole["verdicts"], strict=True):
        single = document(taction("verify", file, "--json", "--changes", "0"))
        same = {key: value for key, value in single.items() if key not in VARYING}
        assert same == {key: value for key, value in found.items() if key not in VARYING}


@pytest.mark.usefixtures("boards")
def test_the_exit_status_is_the_worst_and_a_bad_file_stops_no_other() -> None:
    result = taction("verify", ".", "--json", "--jobs", "1", "--junit", "x.xml")
    assert result.exit_code == 2
    found = json.loads(result.stdout)
    assert found["counts"] == {"pass": 1, "fail": 1, "bad input": 1}
    bad = found["verdicts"][1]
    assert bad["file"].endswith("bad.toml")
    assert bad["error"]["complaints"][0]["key"] == "problem.kind"
    root = ET.fromstring(Path("x.xml").read_text(encoding="utf-8"))  # noqa: S314 - our own file
    assert (root.get("failures"), root.get("errors")) == ("1", "1")
    assert [suite.get("name") for suite in root] == ["a", "bad", "slow"]
    text = taction("verify", ".", "--jobs", "1").stdout
    assert "settles to ±1 % in " in text
    assert "3 scenes: 1 pass, 1 fail, 1 bad input" in text


def test_the_document_has_the_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The server is replaced by one that only announces itself: a page would stay until Ctrl-C."""

    def announced(scene: Any, *, announce: Callable[[str], None], **_: Any) -> None:
        announce("http://127.0.0.1:1234/?token=x")

    monkeypatch.setattr(server, "explore", announced)
    found = document(taction("explore", str(write_fast(tmp_path / "a.toml")), "--json"))
    assert found["address"] == "http://127.0.0.1:1234/?token=x"
    jsonschema.validate(found, schema("explore"))


@pytest.mark.parametrize(
    ("line", "needs"),
    [
        ("explore a.toml --no-browser", "jinja2 and plotly and starlette and uvicorn and websockets"
         ": pip install 'taction[explore]'"),
        ("verify a.toml --report x.html", "jinja2 and plotly: pip install 'taction[report]'"),
        ("verify a.toml --plot x.svg", "matplotlib: pip install 'taction[plot]'"),
        ("simulate a.toml -o x.parquet",
         "pyarrow: pip install 'taction[parquet]'; or write .csv or .raw"),
        ("sweep a.toml --over C=1pF,2pF --export x.parquet",
         "pyarrow: pip install 'taction[parquet]'; or write .csv"),
        ("mcp .", "mcp: pip install 'taction[mcp]'"),
    ],
)  # fmt: skip
def test_missing_packages_are_named_before_any_work(
    line: str, needs: str, boards: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {*boards.iterdir()}
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None)
    result = taction(*line.split())
    assert result.exit_code == 2
    assert f": needs {needs}" in " ".join(result.stderr.split())
    assert {*boards.iterdir()} == before
