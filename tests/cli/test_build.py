"""``taction build``, and commands on one board or none: decks, parts, drawings, op-amps."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest
from click.testing import Result

from taction.netlist_gen.scene.scene import load_scene
from tests.support.command_lines import PINS, VENDOR
from tests.support.paths import SCENES
from tests.support.running import document, taction

OWN = {"report.html", "parts.csv", "wiring.csv", "deck.cir", "kicad"}
CUSTOM = str(SCENES / "custom-matrix.toml")
PREFIXES = {"": 1.0, "p": 1e-12, "n": 1e-9, "u": 1e-6, "k": 1e3, "M": 1e6}


@pytest.fixture
def folder(boards: Path) -> Path:
    return boards / "new" / "built"


def built(folder: Path, scene: str = "a.toml", *more: str) -> Result:
    return taction("build", scene, "-o", str(folder), *more)


def test_the_folder_holds_all_that_a_builder_needs_also_of_a_board_that_fails(folder: Path) -> None:
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
    found = built(folder, "slow.toml")
    assert found.exit_code == 1
    assert found.stdout.rstrip().endswith("FAIL")
    assert {file.name for file in folder.iterdir()} == OWN
    assert (folder / "deck.cir").read_text() == taction("netlist", "slow.toml").stdout
    assert "20p" in parts.read_text()


def test_the_other_files_need_no_verdict(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_csv_and_json_agree(tmp_path: Path) -> None:
    file = tmp_path / "parts.csv"
    found = document(taction("bom", CUSTOM, "-o", str(file), "--json"))
    with file.open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    assert list(rows[0])[:5] == ["Reference", "Value", "Footprint", "Quantity", "DNP"]
    *parts, opamps = rows
    assert [row["Value"] for row in parts][:3] == ["10k", "52.6316k", "54.9451k"]
    for row, part in zip(parts, found["parts"], strict=True):
        number, prefix = re.fullmatch(r"([\d.]+)([pnukM]?)", row["Value"]).groups()
        assert len(number.replace(".", "")) <= 6
        assert float(number) * PREFIXES[prefix] == pytest.approx(part["value"], rel=5.1e-6)
        assert row["Reference"].split(",") == part["references"]
        assert int(row["Quantity"]) == part["count"] == len(part["references"])
        assert (row["Preferred"] == "") is part["standard"]
    assert opamps["Reference"].split(",") == [f"U{k}" for k in range(1, 20)]
    assert found["power"]["total"] == pytest.approx(19 * 30 * 1.3e-3, rel=0.2)


@pytest.mark.parametrize(("name", "supply"), [("lm324", 15.0), ("ad8065", 12.0)])
def test_a_new_scene_has_the_op_amp_asked_for(name: str, supply: float, tmp_path: Path) -> None:
    file = tmp_path / "board.toml"
    assert taction("new", str(file), "--opamp", name).exit_code == 0
    design = load_scene(file).design
    assert (design.opamp.base, design.supply) == (name, supply)
    unknown = taction("new", str(file), "--force", "--opamp", "lm342")
    assert unknown.exit_code == 2
    assert "'lm342': no preset; did you mean 'lm324'?" in " ".join(unknown.stderr.split())
    assert load_scene(file).design.opamp.base == name


def test_one_op_amp_is_shown_with_its_sources() -> None:
    shown = document(taction("models", "show", "ua741", "--json"))
    bias, source = shown["figures"]["bias_current"], shown["figures"]["dc_gain"]["source"]
    known = {"value": 80e-9, "unit": "A", "note": "", "source": source, "guaranteed": 500e-9}
    assert bias == known | {"guaranteed_source": source}
    assert "SLOS009A" in source
    assert shown["figures"]["voltage_noise"]["source"] == "assumed"
    assert shown["figures"]["saturation"]["note"] == "14 V of 15 V into 10 kohm"


def test_a_netlist_becomes_a_file_for_scenes(ngspice: str, tmp_path: Path) -> None:
    target = tmp_path / "amp.json"
    words = ("models", "import", VENDOR, *PINS.split(), "--supply", "±12V", "-o", str(target))
    found = document(taction(*words, "--json"))
    assert found["supply"] == 12.0
    assert 1e5 < found["figures"]["dc_gain"] < 3e5
    assert found["linear"]["error"] <= 1e-6
    assert json.loads(target.read_text())["netlist"][0] == ".subckt m_fet100 inp inn vcc vee out"
