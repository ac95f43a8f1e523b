"""``taction netlist``: its options reach the deck, and a refusal ends with 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.cli.boards import DIALECTS as NAMES
from taction.netlist_gen.deck.dialects.table import DIALECTS
from tests.support.paths import SCENES
from tests.support.running import document, taction

SCENE = str(SCENES / "known-readings.toml")


def test_the_names_of_the_option_are_the_dialects() -> None:
    assert list(NAMES) == list(DIALECTS) == [load().name for load in DIALECTS.values()]


@pytest.mark.parametrize("dialect", NAMES)
def test_a_deck_in_a_dialect_is_printed(dialect: str) -> None:
    result = taction("netlist", SCENE, "--dialect", dialect)
    assert result.exit_code == 0
    assert ("written for" in result.stdout) == (dialect != "ngspice")
    assert "1047197.5511965977" in result.stdout  # Rf_1_1, a sixth of pi times 2 Mohm


def test_parameters_and_measures_are_asked_for() -> None:
    plain = taction("netlist", SCENE).stdout
    assert ".param" not in plain
    assert ".meas" not in plain
    made = document(taction("netlist", SCENE, "--parameters", "--measure", "--json"))["deck"]
    assert "\n.param gain=1000000.0\n" in made
    assert "\n.meas tran t_rise_2 TRIG V(v_2) " in made


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
