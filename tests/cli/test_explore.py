"""``taction explore`` without a page, and ``verify --set``."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import taction
from taction.verification.report.documents.document_catalogue import schema
from taction.verification.report.explorer import server
from tests.support.entries import write_fast
from tests.support.running import document
from tests.support.running import taction as run

SET = ("--set", "C=20pF", "--set", "design.gain=2Mohm")


def test_set_values_are_those_of_a_file_with_them(tmp_path: Path) -> None:
    scene = write_fast(tmp_path / "a.toml")
    given = document(run("verify", str(scene), "--engine", "statespace", "--json", *SET))
    plain = document(run("verify", str(scene), "--engine", "statespace", "--json"))
    changed = taction.load_scene(scene).model_dump(by_alias=True, exclude_unset=True)
    changed["design"] |= {"capacitance": 2e-11, "gain": 2e6}
    expected = taction.verify(taction.Scene(**changed), engine="statespace")
    assert expected.measurements.settling_time is not None
    reading = expected.measurements.settling_time.value
    assert given["settling_time"] == pytest.approx(reading, rel=1e-9)
    assert given["settling_time"] != plain["settling_time"]


def test_the_document_has_the_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The server is replaced by one that only announces itself: a page would stay until Ctrl-C."""

    def announced(scene: Any, *, announce: Callable[[str], None], **_: Any) -> None:
        announce("http://127.0.0.1:1234/?token=x")

    monkeypatch.setattr(server, "explore", announced)
    found = document(run("explore", str(write_fast(tmp_path / "a.toml")), "--json"))
    assert found["address"] == "http://127.0.0.1:1234/?token=x"
    jsonschema.validate(found, schema("explore"))


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name == "starlette" else find(name)
    )
    result = run("explore", str(write_fast(tmp_path / "a.toml")), "--no-browser")
    assert result.exit_code == 2
    assert "pip install 'taction[explore]'" in result.stderr
