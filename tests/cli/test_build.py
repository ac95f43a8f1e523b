"""``taction build``: the files, the verdict's exit status, and what is refused."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from click.testing import Result

from taction.netlist_gen.scene.loading import load_scene
from tests.support.entries import write_fast
from tests.support.running import document, taction

OWN = {"report.html", "parts.csv", "wiring.csv", "deck.cir", "kicad"}


@pytest.fixture
def folder(boards: Path) -> Path:
    return boards / "new" / "built"


def built(folder: Path, scene: str = "a.toml", *more: str) -> Result:
    return taction("build", scene, "-o", str(folder), *more)


def test_the_folder_holds_all_that_a_builder_needs(folder: Path) -> None:
    found = built(folder)
    assert found.exit_code == 0
    assert found.stdout.rstrip().endswith("PASS")
    assert {file.name for file in folder.iterdir()} == OWN
    parts, bom = folder / "parts.csv", folder.parent / "bom.csv"
    taction("bom", "a.toml", "-o", str(bom))
    assert parts.read_text() == bom.read_text()
    assert (folder / "deck.cir").read_text() == taction("netlist", "a.toml").stdout
    drawn = {file.name for file in (folder / "kicad").iterdir()}
    assert {"fast.kicad_pro", "fast.kicad_sch", "channel-3.kicad_sch", "row-3.kicad_sch"} <= drawn
    assert (folder / "report.html").read_text().rstrip().endswith("</html>")


def test_a_second_time_replaces_the_files(folder: Path) -> None:
    built(folder)
    before = {file: file.read_bytes() for file in folder.rglob("*.*")}
    write_fast(Path("a.toml"), capacitance="47pF")
    assert built(folder).exit_code == 0
    after = {file: file.read_bytes() for file in folder.rglob("*.*")}
    assert before.keys() == after.keys()
    changed = {file.name for file in before if before[file] != after[file]}
    assert {"parts.csv", "wiring.csv", "deck.cir", "report.html", "channel-1.kicad_sch"} <= changed


def test_a_board_that_fails_is_built_with_status_1(folder: Path) -> None:
    found = built(folder, "slow.toml")
    assert found.exit_code == 1
    assert found.stdout.rstrip().endswith("FAIL")
    assert {file.name for file in folder.iterdir()} == OWN


def test_without_a_verdict_the_other_files_are_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built(folder)
    report = (folder / "report.html").read_text()
    monkeypatch.setenv("TACTION_NGSPICE", "/nonexistent")
    found = built(folder, "a.toml", "--engine", "ngspice", "--json")
    assert found.exit_code == 3
    said = document(found)
    assert (said["outcome"], said["checks"]) == ("inconclusive", None)
    assert "no executable '/nonexistent'" in said["refused"]
    assert {file.name for file in folder.iterdir()} == OWN
    new = (folder / "report.html").read_text()
    assert new != report  # no verdict of an earlier board
    assert "no executable" in new


def test_foreign_files_are_kept(folder: Path) -> None:
    built(folder)
    notes = folder / "kicad" / "notes.txt"
    notes.write_text("mine\n")
    before = {file: file.stat().st_mtime_ns for file in folder.rglob("*.*")}
    found = built(folder)
    assert found.exit_code == 2
    assert "it holds 'kicad/notes.txt', not written by this command" in found.stderr
    assert before == {file: file.stat().st_mtime_ns for file in folder.rglob("*.*")}
    here = built(folder.parents[1])
    assert here.exit_code == 2
    assert "expected a new or empty folder" in here.stderr


@pytest.mark.parametrize("name", ["deck.cir", "kicad"])
def test_no_file_is_written_where_a_link_leads(boards: Path, tmp_path: Path, name: str) -> None:
    other = tmp_path / "other"
    if name == "kicad":
        other.mkdir()
    else:
        other.write_text("mine\n")
    place = boards / "linked"
    place.mkdir()
    (place / name).symlink_to(other)
    found = built(place)
    assert found.exit_code == 2
    assert f"'{name}' in it is a link" in found.stderr
    assert not list(other.iterdir()) if other.is_dir() else other.read_text() == "mine\n"


def test_the_deck_runs_and_a_new_board_is_built(folder: Path, ngspice: str) -> None:
    """`taction new`, then `taction build`: standard values, and a deck that ngspice accepts."""
    taction("new", "new.toml")
    found = built(folder, "new.toml")
    assert found.exit_code == 0
    assert "not a standard value: 0" in found.stdout
    record = folder.parent / "out.raw"
    command = [ngspice, "-b", "-r", str(record), str(folder / "deck.cir")]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0
    assert record.stat().st_size > 1000
    name = load_scene("new.toml").name
    assert (folder / "kicad" / f"{name}.kicad_pro").is_file()
