"""The commands on one board, and those without a board: decks, parts, drawings, op-amps."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest

from taction.netlist_gen.scene.loading import load_scene
from tests.support.paths import SCENES
from tests.support.running import document, taction

CUSTOM = str(SCENES / "custom-matrix.toml")


PREFIXES = {"": 1.0, "p": 1e-12, "n": 1e-9, "u": 1e-6, "k": 1e3, "M": 1e6}


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
    assert (opamps["Reference"], opamps["Value"]) == (
        ",".join(f"U{k}" for k in range(1, 20)),
        "OPA189",
    )
    assert found["opamps"]["spare"] == 0
    assert found["power"]["quiescent"] == pytest.approx(19 * 30 * 1.3e-3)


def test_new_does_not_overwrite(tmp_path: Path) -> None:
    file = tmp_path / "board.toml"
    assert document(taction("new", str(file), "--json"))["file"] == str(file)
    again = taction("new", str(file))
    assert again.exit_code == 2
    assert "--force" in again.stderr
    assert taction("new", str(file), "--force").exit_code == 0


@pytest.mark.parametrize(("name", "supply"), [("lm324", 15.0), ("ad8065", 12.0)])
def test_a_new_scene_has_the_op_amp_that_is_asked_for(
    name: str, supply: float, tmp_path: Path
) -> None:
    file = tmp_path / "board.toml"
    assert taction("new", str(file), "--opamp", name).exit_code == 0
    design = load_scene(file).design
    assert (design.opamp.base, design.supply) == (name, supply)
    unknown = taction("new", str(file), "--force", "--opamp", "lm342")
    assert unknown.exit_code == 2
    assert "'lm342': no preset; did you mean 'lm324'?" in " ".join(unknown.stderr.split())
    assert load_scene(file).design.opamp.base == name


def test_the_folder_holds_a_project(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "board"
    found = document(taction("kicad", CUSTOM, "-o", str(folder), "--json"))
    sheets = {f"{kind}-{n}.kicad_sch" for kind, count in (("channel", 4), ("row", 6))
              for n in range(1, count + 1)}  # fmt: skip
    assert {Path(name).name for name in found["files"]} == sheets | {
        "custom-matrix.kicad_sch",
        "custom-matrix.kicad_pro",
        "custom-matrix.kicad_sym",
        "sym-lib-table",
    }
    assert all(Path(name).is_file() for name in found["files"])
    assert any("stray" in text for text in found["not_drawn"])


def test_another_project_is_not_damaged(tmp_path: Path) -> None:
    table = tmp_path / "sym-lib-table"
    table.write_text("(sym_lib_table (version 7))\n")
    result = taction("kicad", CUSTOM, "-o", str(tmp_path))
    assert result.exit_code == 2
    assert "give another folder" in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["sym-lib-table"]
    assert table.read_text() == "(sym_lib_table (version 7))\n"


def test_one_op_amp_is_shown_with_its_sources() -> None:
    shown = document(taction("models", "show", "ua741", "--json"))
    assert shown["figures"]["bias_current"] == {
        "value": 80e-9,
        "unit": "A",
        "note": "",
        "source": shown["figures"]["dc_gain"]["source"],
        "guaranteed": 500e-9,
        "guaranteed_source": shown["figures"]["bias_current"]["source"],
    }
    assert "SLOS009A" in shown["figures"]["bias_current"]["source"]
    assert shown["figures"]["voltage_noise"]["source"] == "assumed"
    assert shown["figures"]["saturation"]["note"] == "14 V of 15 V into 10 kohm"


VENDOR = Path(__file__).parents[1] / "data" / "fet100.cir"
PINS = "inp,inn,vcc,vee,out"


def test_a_netlist_becomes_a_file_for_scenes(ngspice: str, tmp_path: Path) -> None:
    target = tmp_path / "amp.json"
    run = taction(
        "models", "import", str(VENDOR), "--subckt", "FET100", "--pins", PINS,
        "--supply", "±12V", "-o", str(target), "--json",
    )  # fmt: skip
    found = document(run)
    assert found["supply"] == 12.0
    assert 1e5 < found["figures"]["dc_gain"] < 3e5
    assert found["linear"]["error"] <= 1e-6
    assert json.loads(target.read_text())["netlist"][0] == ".subckt m_fet100 inp inn vcc vee out"


SCENE = str(SCENES / "known-readings.toml")
