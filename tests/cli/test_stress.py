"""`taction stress`: the cases that are asked for, files, and exit statuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

from tests.support.running import document, taction

ONE = ("stress", "--jobs", "1", "--only")


@pytest.mark.usefixtures("ngspice")
def test_one_case_as_json_and_in_files(tmp_path: Path) -> None:
    junit, page = tmp_path / "s.xml", tmp_path / "s.md"
    done = taction(*ONE, "two-channels", "--junit", str(junit), "--page", str(page), "--json")
    assert done.exit_code == 0, done.stderr
    found = document(done)
    assert [(run["case"], run["engine"]) for run in found["runs"]] == [
        ("two-channels", "ngspice"),
        ("two-channels", "statespace"),
    ]
    assert found["count"] == {"right": 2}
    assert etree.parse(str(junit)).getroot().get("tests") == "2"
    assert "| two-channels | ngspice | pass |" in page.read_text("utf-8")
    assert "taction: 1 cases, about" in done.stderr
    assert done.stderr.splitlines()[-2:] == [f"wrote {junit}", f"wrote {page}"]


def test_a_family_as_a_table() -> None:
    done = taction(*ONE, "refused", "--only", "wrong-shape")
    assert "wrong-shape" in done.stdout
    assert "not-a-number" in done.stdout
    assert "right" in done.stdout.splitlines()[-1] or "right" in done.stdout


def test_an_unknown_name_is_bad_input() -> None:
    refused = taction(*ONE, "identiti")
    assert refused.exit_code == 2
    assert "did you mean 'identity'?" in refused.stderr


def test_a_folder_that_is_missing_is_known_before_the_run(tmp_path: Path) -> None:
    refused = taction(*ONE, "two-channels", "--page", str(tmp_path / "none" / "s.md"))
    assert refused.exit_code == 2
    assert "--page" in refused.stderr


def test_without_ngspice_the_status_is_3(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", "/nowhere/ngspice")
    done = taction(*ONE, "two-channels", "--json")
    assert done.exit_code == 3
    assert document(done)["count"] == {"right": 1, "not run": 1}


def test_a_wrong_outcome_has_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    from taction.verification.evidence.stress import catalogue

    cases = catalogue.select(catalogue.load_catalogue(), ("wrong-shape",))
    planted = tuple(replace(case, outcome={"statespace": ("pass",)}) for case in cases)
    monkeypatch.setattr(catalogue, "load_catalogue", lambda: planted)
    done = taction(*ONE, "wrong-shape")
    assert done.exit_code == 1
    assert "InputError" in done.stdout
    assert "wrong outcome" in done.stdout
