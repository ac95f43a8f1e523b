"""Margins in C and in the gain, against the crossings that the onset study finds."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from cli.main import main
from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.overrides.axes import with_value
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.file import load_scene
from tests.support.paths import SCENES
from verification.small_signal.margin import (
    REACH,
    capacitance_margin,
    gain_margin,
    with_capacitance,
    with_gain,
)
from verification.small_signal.poles import poles

FILE = SCENES / "tuned-breadboard.toml"
SCENE = load_scene(FILE)


def board(path: str = "name", value: float | str = "tuned") -> Circuit:
    scene = with_value(SCENE, path, value)
    return synthesise(scene, make_problem(scene))


def test_c_may_shrink_to_its_crossing() -> None:
    margin = capacitance_margin(board())
    known = capacitance_margin(board(), found=poles(board()))
    assert known.factor == pytest.approx(margin.factor, rel=1e-9)
    assert margin.factor == pytest.approx(10e-12 / 4.1337463e-12, rel=2e-6)
    assert margin.text == "C can shrink by the factor 2.419, to 4.134 pF"


def test_the_gain_may_grow_to_its_crossing() -> None:
    margin = gain_margin(board())
    assert margin.factor == pytest.approx(4.7034537e6 / 2.3e6, rel=2e-6)
    assert margin.text == "the gain can grow by the factor 2.045, to 4.703 Mohm"


def test_a_board_with_another_gain_is_the_one_that_the_synthesis_makes() -> None:
    changed, made = with_gain(board(), 3e6), board("design.gain", 3e6)
    assert changed.resistors == made.resistors
    assert changed.scalings.gain == 3e6
    assert changed.scalings.lam == pytest.approx(made.scalings.lam, rel=1e-12)
    assert (
        with_capacitance(board(), 2e-12).capacitors == board("design.capacitance", 2e-12).capacitors
    )


def test_an_unstable_board_has_no_margin() -> None:
    margin = gain_margin(board("design.gain", 5e6))
    assert (margin.factor, margin.text) == (0.0, "the board is unstable")


def test_a_board_that_nothing_upsets_has_the_largest_margin_that_is_looked_for() -> None:
    margin = capacitance_margin(board("design.gain", 1e5))
    assert (margin.factor, margin.text) == (REACH, "no crossing up to C/100")


def test_verify_reports_both_margins_when_asked() -> None:
    arguments = ["verify", str(FILE), "--engine", "statespace", "--json"]
    runner = CliRunner()
    found = json.loads(runner.invoke(main, [*arguments, "--margins"]).stdout)["stability"]
    assert found["margins"]["capacitance"]["factor"] == pytest.approx(2.41911, rel=1e-5)
    assert found["margins"]["gain"]["factor"] == pytest.approx(2.04498, rel=1e-5)
    assert "margins" not in json.loads(runner.invoke(main, arguments).stdout)["stability"]
