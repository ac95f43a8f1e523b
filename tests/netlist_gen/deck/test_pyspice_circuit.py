"""A deck as a PySpice circuit: its text, run by ngspice, is the same board, also after a change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from tests.support.making import make_scene
from tests.support.other_simulators import ngspice_record
from tests.support.paths import SCENES

RUN = Transient(5e-6, 2.5e-8)
LARGE = {"opamp": {"base": "ua741", "input_errors": True}}


def scene(name: str) -> Scene:
    if name == "errors":
        return make_scene({"channels": 3, "span": 2.0}, design=LARGE)
    return load_scene(SCENES / f"{name}.toml")


def deck_of(name: str, **options: Any) -> Deck:
    read = scene(name)
    run = replace(RUN, initial=read.analysis.initial)
    return write_deck(synthesise(read), run, **options)


def with_analysis(circuit: Any, deck: Deck) -> Deck:
    """The text of a PySpice circuit as a deck, with the analysis of `deck`."""
    cards = [line for line in deck.text.split("\n") if line.startswith((".save", ".tran", ".end"))]
    last = [line for line in cards if not line.startswith(".ends")]
    return replace(deck, text="\n".join([str(circuit), *last, ""]), files={})


@pytest.mark.parametrize(
    ("name", "matrix_file"),
    [("paper-breadboard", "m.inc"), ("paper-exponential-devices", None), ("errors", None)],
)
def test_its_text_is_the_same_board(
    name: str, matrix_file: str | None, ngspice: str, tmp_path: Path
) -> None:
    deck = deck_of(name, matrix_file=matrix_file)
    expected = ngspice_record(deck, tmp_path)
    found = ngspice_record(with_analysis(deck.to_pyspice(), deck), tmp_path)
    np.testing.assert_allclose(found[1], expected[1], rtol=0, atol=1e-9)


def test_a_changed_capacitor_is_the_override(ngspice: str, tmp_path: Path) -> None:
    read = load_scene(SCENES / "known-readings.toml")
    deck = write_deck(synthesise(read), RUN)
    circuit = deck.to_pyspice()
    for n in (1, 2, 3):
        circuit[f"Cc_{n}"].capacitance = 33e-12
    larger = read.design.model_copy(update={"capacitance": 33e-12})
    other = write_deck(synthesise(read.model_copy(update={"design": larger})), RUN)
    expected = ngspice_record(other, tmp_path)
    found = ngspice_record(with_analysis(circuit, deck), tmp_path)
    there = np.array([np.interp(found[0], expected[0], row) for row in expected[1]])
    np.testing.assert_allclose(found[1], there, rtol=0, atol=1e-4)
    before = ngspice_record(deck, tmp_path)
    assert np.abs(before[1][:, -1] - expected[1][:, -1]).max() > 0.1


def test_elements_subcircuits_and_models_have_names() -> None:
    name = "paper-exponential-devices"
    circuit = synthesise(scene(name))
    made = deck_of(name).to_pyspice()
    assert made.Rf_1_1.resistance == float(circuit.forward.ohms[0, 0])
    assert [cell.name for cell in made.subcircuits] == ["ideal_changed"]
    assert next(iter(made.subcircuits)).Ro.resistance == 75.0
    assert [model.name for model in made.models] == ["ssm2220"]
    assert str(made.Cc_1) == "Cc_1 v_1 x_1 4.7e-11"


def test_another_dialect_is_refused() -> None:
    with pytest.raises(ValueError, match="'hspice' has no PySpice circuit; expected ngspice"):
        deck_of("known-readings", dialect="hspice").to_pyspice()
