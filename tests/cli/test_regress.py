"""``taction regress`` from the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from taction.cli.main import main
from tests.support.entries import write_fast
from tests.support.paths import ROOT


def taction(*words: object) -> Result:
    return CliRunner().invoke(main, ["regress", *map(str, words)])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes"
    folder.mkdir()
    write_fast(folder / "a.toml")
    assert taction(folder, "--baseline", tmp_path / "b.json", "--update").exit_code == 0
    return folder


def test_update_writes_the_same_bytes_again(folder: Path) -> None:
    file = folder.parent / "b.json"
    before = file.read_bytes()
    assert taction(folder, "--baseline", file, "--update").exit_code == 0
    assert file.read_bytes() == before
    file.unlink()
    assert taction(folder, "--baseline", file, "--update").exit_code == 0
    assert file.read_bytes() == before


def test_reports_and_one_json_document(folder: Path) -> None:
    write_fast(folder / "a.toml", capacitance="10.5pF")
    junit, markdown = folder.parent / "j.xml", folder.parent / "m.md"
    reports = ("--junit", junit, "--markdown", markdown)
    result = taction(folder, "--baseline", folder.parent / "b.json", *reports, "--json")
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert (document["exit_status"], document["counts"]) == (1, {"changed": 1})
    assert 'status" value="changed"' in junit.read_text(encoding="utf-8")
    assert "### a.toml: changed" in markdown.read_text(encoding="utf-8")
    assert result.stderr.splitlines() == [f"wrote {junit}", f"wrote {markdown}"]


@pytest.mark.parametrize("text", ['{"taction_baseline": 99, "scenes": {}}', "{", '{"a": 1}'])
@pytest.mark.parametrize("update", [(), ("--update",)])
def test_a_file_that_is_no_baseline_of_ours_is_refused_and_never_overwritten(
    folder: Path, text: str, update: tuple[str, ...]
) -> None:
    file = folder.parent / "other.json"
    file.write_text(text)
    result = taction(folder, "--baseline", file, *update, "--json")
    assert result.exit_code == 2
    assert json.loads(result.stdout)["outcome"] == "bad input"
    assert file.read_text() == text


def test_a_report_that_cannot_be_written_spoils_neither_result_nor_baseline(folder: Path) -> None:
    write_fast(folder / "a.toml", capacitance="10.5pF")
    file = folder.parent / "b.json"
    before = file.read_bytes()
    words = ("--update", "--junit", "/dev/full", "--json")
    result = taction(folder, "--baseline", file, *words)
    assert result.exit_code == 2
    assert "No space left on device" in result.stderr
    assert json.loads(result.stdout)["counts"] == {"changed": 1}
    assert file.read_bytes() != before


def test_a_report_in_no_folder_is_refused_before_anything_runs(folder: Path) -> None:
    result = taction(folder, "--baseline", folder.parent / "b.json", "--junit", "no/where.xml")
    assert result.exit_code == 2
    assert "--junit" in result.stderr
    assert result.stdout == ""


# A real signal, at a known moment: while the second scene is verified.
INTERRUPT = """
import signal
from taction.cli.main import main
from taction.verification.studies.regression import run

verify = run.verify
def interrupted(scene):
    if scene.name == "second":
        signal.raise_signal(signal.SIGINT)
    return verify(scene)
run.verify = interrupted
main()
"""


def test_ctrl_c_leaves_a_whole_baseline_and_says_so(folder: Path) -> None:
    write_fast(folder / "a.toml", capacitance="10.5pF")
    for name in ("b.toml", "c.toml"):
        scene = write_fast(folder / name)
        scene.write_text(scene.read_text().replace("fast", "second"))
    file = folder.parent / "b.json"
    words = ("regress", folder, "--baseline", file, "--update", "--json", "--jobs", "1")
    run = subprocess.run(
        [sys.executable, "-c", INTERRUPT, *map(str, words)],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert run.returncode == 130, run.stderr
    assert "interrupted; the finished scenes are in the report" in run.stderr
    assert json.loads(run.stdout)["counts"] == {"changed": 1, "not run": 2}
    assert set(json.loads(file.read_text())["scenes"]) == {"a.toml"}
    after = taction(folder, "--baseline", file, "--json")
    assert json.loads(after.stdout)["counts"] == {"same": 1, "new": 2}


def test_several_processes_give_the_same_results(folder: Path) -> None:
    write_fast(folder / "b.toml", capacitance="10.5pF")
    (folder / "c.toml").write_text("no scene")
    found = []
    for jobs in ("1", "2"):
        result = taction(folder, "--baseline", folder.parent / "b.json", "--jobs", jobs, "--json")
        assert result.exit_code == 2
        found.append(json.loads(result.stdout))
        for scene in found[-1]["scenes"]:
            del scene["seconds"]
    assert found[0] == found[1]
    assert found[0]["counts"] == {"same": 1, "new": 1, "bad input": 1}
