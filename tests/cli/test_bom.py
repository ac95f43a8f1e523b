"""``taction bom``: the table, the CSV with KiCad's columns, and the JSON document."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from tests.support.paths import SCENES
from tests.support.running import document, taction

CUSTOM = str(SCENES / "custom-matrix.toml")


def test_the_table_has_engineering_units() -> None:
    result = taction("bom", CUSTOM)
    assert result.exit_code == 0
    text = " ".join(result.stdout.split())
    for part in ("resistor 10 kohm 18", "capacitor 100 pF 4", "5 packages tl084, U1 to U5"):
        assert part in text
    assert "spare op-amps: 1 in U5" in text
    assert "op-amps 798 mW quiescent" in text  # 19 times 1.4 mA at 30 V
    assert "not a standard value: 18; set resistor_series" in text


def test_csv_and_json_agree_in_base_units(tmp_path: Path) -> None:
    file = tmp_path / "parts.csv"
    found = document(taction("bom", CUSTOM, "-o", str(file), "--json"))
    with file.open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    assert list(rows[0])[:5] == ["Reference", "Value", "Footprint", "Quantity", "DNP"]
    *parts, opamps = rows
    assert [float(row["Value"]) for row in parts] == [part["value"] for part in found["parts"]]
    for row, part in zip(parts, found["parts"], strict=True):
        assert row["Reference"].split(",") == part["references"]
        assert int(row["Quantity"]) == part["count"] == len(part["references"])
        assert (row["Preferred"] == "") is part["standard"]
    assert (opamps["Reference"], opamps["Value"]) == ("U1,U2,U3,U4,U5", "TL084")
    assert found["opamps"]["spare"] == 1
    assert found["power"]["quiescent"] == pytest.approx(19 * 30 * 1.4e-3)


def test_a_file_that_cannot_be_written_is_refused() -> None:
    result = taction("bom", CUSTOM, "-o", "/nowhere/parts.csv")
    assert result.exit_code == 2
    assert "its folder does not exist" in result.stderr
    same = taction("bom", CUSTOM, "-o", CUSTOM)
    assert same.exit_code == 2
    assert "expected another file" in same.stderr


def test_netlist_and_verify_warn_about_the_same_parts() -> None:
    board = str(SCENES / "paper-breadboard.toml")
    says = "60 of 74 matrix resistors are above 50 Mohm, up to 247.3 Mohm (Rf_1_7)"
    netlist = taction("netlist", board, "--json")
    assert f"warning: {says}" in netlist.stderr
    verify = document(taction("verify", board, "--engine", "statespace", "--json"))
    for found in (document(netlist), verify):
        assert [text.partition(";")[0] for text in found["warnings"] if "ohm" in text] == [says]
