"""The command `taction models import`."""

from __future__ import annotations

import json
from pathlib import Path

from tests.support.running import document, taction

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
    assert json.loads(target.read_text())["netlist"][0] == ".subckt m_fet100 1 2 3 4 5"


def test_a_hostile_netlist_is_bad_input_and_names_its_line(tmp_path: Path) -> None:
    file = tmp_path / "bad.cir"
    file.write_text(".subckt p 1 2 3 4 5\nr1 1 2 1k\n.control\nshell ls\n.endc\n.ends\n")
    run = taction("models", "import", str(file), "--subckt", "p", "--pins", PINS)
    assert run.exit_code == 2
    assert "line 3 '.control'" in run.stderr
    assert not list(tmp_path.glob("*.json"))


def test_a_wrong_supply_is_bad_input() -> None:
    run = taction("models", "import", str(VENDOR), "--subckt", "FET100", "--pins", PINS,
                  "--supply", "15A")  # fmt: skip
    assert run.exit_code == 2
    assert "--supply" in run.stderr
