"""C, gain and lambda as parameters: an edited number is the same board as an override."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.board_cards import parameters_of
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.scene.loading import load_scene
from tests.support.making import make_scene
from tests.support.other_simulators import distance, gnucap_record, ngspice_record
from tests.support.paths import SCENES

MODES = {"ngspice": "", "ltspice": "ltpsa", "hspice": "hsa", "xyce": ""}
DESIGNS: dict[str, dict[str, Any]] = {
    "linear": {},
    "exponential": {"amplifier": "exponential", "exponential_slope": 0.2, "unit_voltage": 0.5},
    "passive": {"topology": "passive"},
}
VALUES = [(10e-12, 1e6, 20.0), (33e-12, 2.7e6, 7.3), (4.7e-12, 0.51e6, 31.0)]
RUN = Transient(1e-5, 2.5e-8)


def board(kind: str, C: float, gain: float, lam: float) -> Circuit:
    design = {"capacitance": C, "gain": gain, "lambda": lam, "unit_conductance": "2uS"}
    problem = {"channels": 3, "span": 2.0}
    return synthesise(make_scene(problem, design=design | DESIGNS[kind]))


def edited(text: str, name: str, value: float) -> str:
    """The text of a deck after a user has changed one number."""
    changed, count = re.subn(rf"(?m)^\.param {name}=.*$", f".param {name}={value!r}", text)
    assert count == 1
    return changed


def board_at(deck: Deck, C: float, gain: float, lam: float) -> Deck:
    text = edited(edited(edited(deck.text, "C", C), "gain", gain), "lambda", lam)
    return replace(deck, text=text)


@pytest.mark.parametrize("values", VALUES[1:2])
@pytest.mark.parametrize("dialect", MODES)
@pytest.mark.parametrize("kind", DESIGNS)
def test_edited_numbers_give_the_waveforms_of_the_overrides(
    kind: str, dialect: str, values: tuple[float, ...], ngspice: str, tmp_path: Path
) -> None:
    first, second = board(kind, *VALUES[0]), board(kind, *values)
    deck = write_deck(first, RUN, dialect=dialect, parameters=parameters_of(first))
    numeric = write_deck(second, RUN, dialect=dialect)
    # Tolerances follow from C: those of the edited deck in both.
    options = [line for line in deck.text.split("\n") if line.startswith(".opt")]
    others = [line for line in numeric.text.split("\n") if line.startswith(".opt")]
    text = numeric.text
    for old, new in zip(others, options, strict=True):
        text = text.replace(old, new)
    expected = ngspice_record(replace(numeric, text=text), tmp_path, MODES[dialect])
    found = ngspice_record(board_at(deck, *values), tmp_path, MODES[dialect])
    np.testing.assert_array_equal(found[0].shape, expected[0].shape)
    np.testing.assert_allclose(found[1], expected[1], rtol=0, atol=1e-9)
    assert distance(expected, ngspice_record(deck, tmp_path, MODES[dialect])) > 0.02


def test_gnucap_evaluates_the_parameters_too(ngspice: str, gnucap: str, tmp_path: Path) -> None:
    first, second = board("linear", *VALUES[0]), board("linear", *VALUES[1])
    deck = write_deck(first, RUN, dialect="xyce", parameters=parameters_of(first))
    time, found = gnucap_record(gnucap, board_at(deck, *VALUES[1]))
    instants, values = ngspice_record(write_deck(second, RUN), tmp_path)
    expected = np.array([np.interp(time, instants, row) for row in values])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3 * np.ptp(values))


@pytest.mark.parametrize("scene", ["paper-breadboard", "paper-exponential-devices"])
def test_a_deck_with_parameters_runs_as_the_deck_with_numbers(
    scene: str, ngspice: str, tmp_path: Path
) -> None:
    read = load_scene(SCENES / f"{scene}.toml")
    circuit = synthesise(read)
    run = replace(RUN, initial=read.analysis.initial)
    expected = ngspice_record(write_deck(circuit, run), tmp_path)
    parameters = parameters_of(circuit)
    found = ngspice_record(write_deck(circuit, run, parameters=parameters), tmp_path)
    np.testing.assert_allclose(found[1], expected[1], rtol=0, atol=1e-9)


def test_with_a_fixed_lambda_only_the_gain_decides_r() -> None:
    lines = parameters_of(board("linear", *VALUES[0]), fixed_lambda=True).lines
    assert not [line for line in lines if "lambda" in line]
    (share,) = (line for line in lines if line.startswith(".param R="))
    assert share == ".param R={12500000000.0/gain}"  # 1 / (20 (2 uS)²)


def test_a_value_that_its_expression_does_not_give_is_refused() -> None:
    design = {"resistor_series": "E24", "gain": "1.02Mohm"}
    circuit = synthesise(make_scene({"channels": 3}, design=design))
    with pytest.raises(ValueError, match=r"r_1 is 1800000.0, but its expression R gives 178"):
        parameters_of(circuit)


def test_spectre_has_no_parameters() -> None:
    circuit = board("linear", *VALUES[0])
    with pytest.raises(ValueError, match="'spectre' cannot express: parameters"):
        write_deck(circuit, RUN, dialect="spectre", parameters=parameters_of(circuit))
