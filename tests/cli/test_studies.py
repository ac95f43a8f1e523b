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

import taction as library
from taction.verification.report.documents.document_catalogue import schema
from taction.verification.report.explorer import server
from tests.support.entries import write_fast
from tests.support.running import document, taction

VARYING = ("timing", "simulation", "accuracy", "taction")  # wall times, and the head
SET = ("--set", "C=20pF", "--set", "design.gain=2Mohm")


def regress(*words: object) -> Result:
    return taction("regress", *map(str, words), "--jobs", "1")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes"
    folder.mkdir()
    write_fast(folder / "a.toml")
    assert regress(folder, "--baseline", tmp_path / "b.json", "--update").exit_code == 0
    return folder


@pytest.mark.parametrize("text", ['{"taction_baseline": 99, "scenes": {}}', "{", '{"a": 1}'])
@pytest.mark.parametrize("update", [(), ("--update",)])
def test_a_file_that_is_no_baseline_of_ours_is_refused_and_never_overwritten(
    folder: Path, text: str, update: tuple[str, ...]
) -> None:
    file = folder.parent / "other.json"
    file.write_text(text)
    result = regress(folder, "--baseline", file, *update, "--json")
    assert result.exit_code == 2
    assert json.loads(result.stdout)["outcome"] == "bad input"
    assert file.read_text() == text


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


def test_the_table_has_a_row_for_each_scene_and_the_reasons_below(boards: Path) -> None:
    (boards / "bad.toml").unlink()
    result = taction("verify", str(boards), "--jobs", "1")
    assert result.exit_code == 1
    assert f"{boards}/a.toml" in result.stdout
    assert "settles to ±1 % in " in result.stdout
    assert "2 scenes: 1 pass, 1 fail" in result.stdout


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


def test_set_values_are_those_of_a_file_with_them(tmp_path: Path) -> None:
    scene = write_fast(tmp_path / "a.toml")
    given = document(taction("verify", str(scene), "--engine", "statespace", "--json", *SET))
    plain = document(taction("verify", str(scene), "--engine", "statespace", "--json"))
    changed = library.load_scene(scene).model_dump(by_alias=True, exclude_unset=True)
    changed["design"] |= {"capacitance": 2e-11, "gain": 2e6}
    expected = library.verify(library.Scene(**changed), engine="statespace")
    assert expected.measurements.settling_time is not None
    reading = expected.measurements.settling_time.value
    assert given["settling_time"] == pytest.approx(reading, rel=1e-9)
    assert given["settling_time"] != plain["settling_time"]


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
