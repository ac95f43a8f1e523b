"""The commands on one board, and those without a board: decks, parts, drawings, op-amps."""

from __future__ import annotations

import csv
import json
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from taction.cli import boards
from taction.netlist_gen.deck.dialects import DIALECTS
from taction.netlist_gen.scene.loading import load_scene
from tests.support.paths import ROOT, SCENES
from tests.support.running import document, taction

CUSTOM = str(SCENES / "custom-matrix.toml")


def test_the_table_has_engineering_units() -> None:
    result = taction("bom", CUSTOM)
    assert result.exit_code == 0
    text = " ".join(result.stdout.split())
    for part in ("resistor 10 kohm 18", "capacitor 100 pF 4", "19 packages opa189, U1 to U19"):
        assert part in text
    assert "spare op-amps" not in text
    assert "op-amps 741 mW quiescent" in text  # 19 times 1.3 mA at 30 V
    assert "not a standard value: 18; set resistor_series" in text


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


def test_netlist_and_verify_warn_about_the_same_parts() -> None:
    board = str(SCENES / "paper-breadboard.toml")
    says = "60 of 74 matrix resistors are above 10 Mohm, up to 247.3 Mohm (Rf_1_7)"
    netlist = taction("netlist", board, "--json")
    assert f"warning: {says}" in netlist.stderr
    verify = document(taction("verify", board, "--engine", "statespace", "--json"))
    for found in (document(netlist), verify):
        assert [text.partition(";")[0] for text in found["warnings"] if "ohm" in text] == [says]


def test_doctor_names_the_kernels_of_each_blas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Prescott")  # every x86-64 processor executes them
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    command = [
        sys.executable,
        "-c",
        "from taction.cli.main import main; main()",
        "doctor",
        "--json",
    ]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    findings = json.loads(run.stdout)["findings"]
    blas = {f["what"]: f["found"] for f in findings if f["what"].startswith("BLAS")}
    assert blas.keys() == {"BLAS of numpy", "BLAS of scipy"}
    assert all("threads: 1" in found for found in blas.values())
    if platform.machine() == "x86_64":
        asked = {name: found for name, found in blas.items() if "openblas" in found}
        assert all(re.search("Katmai|Prescott|Core2", found) for found in asked.values())


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


def test_the_table_says_what_a_sheet_does_not_print(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    text = " ".join(taction("models", "show", "lf353").stdout.split())
    assert "no figure: assumed as of the LF356" in text
    assert "\N{LESS-THAN OR EQUAL TO} 10 mV" in text
    assert "LF353-N Wide Bandwidth Dual JFET Input Operational Amplifier, SNOSBH3F, 2013" in text


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
    assert found["linear"]["error"] < 1e-6
    assert json.loads(target.read_text())["netlist"][0] == ".subckt m_fet100 inp pin vcc vee out"


def test_a_hostile_netlist_is_bad_input_and_names_its_line(tmp_path: Path) -> None:
    file = tmp_path / "bad.cir"
    file.write_text(".subckt p 1 2 3 4 5\na1 1 2 m\n.ends\n")
    run = taction("models", "import", str(file), "--subckt", "p", "--pins", PINS)
    assert run.exit_code == 2
    assert "line 2 = 'a1 1 2 m': a code model of ngspice (A) is not accepted" in " ".join(
        run.stderr.split()
    )
    assert not list(tmp_path.glob("*.json"))


SCENE = str(SCENES / "known-readings.toml")


def test_the_names_of_the_option_are_the_dialects() -> None:
    assert list(boards.DIALECTS) == list(DIALECTS) == [each.name for each in DIALECTS.values()]


@pytest.mark.parametrize("dialect", boards.DIALECTS)
def test_a_deck_in_a_dialect_is_printed(dialect: str) -> None:
    result = taction("netlist", SCENE, "--dialect", dialect)
    assert result.exit_code == 0
    assert ("written for" in result.stdout) == (dialect != "ngspice")
    assert "1047197.5511965977" in result.stdout  # Rf_1_1, a sixth of pi times 2 Mohm


def test_measures_are_asked_for() -> None:
    assert ".meas" not in taction("netlist", SCENE).stdout
    made = document(taction("netlist", SCENE, "--measure", "--json"))["deck"]
    assert "\n.meas tran t_rise_2 TRIG V(v_2) " in made


def test_a_withdrawn_option_says_what_to_do_in_its_place() -> None:
    refused = taction("netlist", SCENE, "--parameters")
    assert refused.exit_code == 2
    assert "Change the number in the scene and write the deck again" in refused.stderr


def test_a_split_deck_of_a_dialect_is_two_files(tmp_path: Path) -> None:
    file = tmp_path / "board.scs"
    result = taction("netlist", SCENE, "--dialect", "spectre", "--split", "-o", str(file))
    assert result.exit_code == 0
    assert 'include "board_matrix.inc"' in file.read_text()
    matrix = (tmp_path / "board_matrix.inc").read_text().split("\n")
    assert matrix[0] == "simulator lang=spectre"
    assert matrix[2].startswith("subckt matrix (")


def test_a_refusal_names_the_key_and_writes_nothing(tmp_path: Path) -> None:
    scene, file = str(SCENES / "paper-exponential.toml"), tmp_path / "board.scs"
    result = taction("netlist", scene, "--dialect", "spectre", "-o", str(file))
    assert result.exit_code == 2
    assert "design.amplifier = 'exponential': no free program reads" in result.stderr
    assert not file.exists()
