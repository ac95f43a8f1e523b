"""Every kind of board in every dialect: written and run by a program that is not ours, or refused.

The deck of ngspice is run by other tests; here its record is what the other decks are compared
with, at equal largest steps.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from spicelib import SpiceEditor

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.scene.scene import Scene, load_scene
from tests.support.making import make_scene
from tests.support.other_simulators import Record, distance, gnucap_record, ngspice_record
from tests.support.paths import SCENES

MODES = {"ltspice": "ltpsa", "hspice": "hsa", "xyce": ""}  # compatibility modes of ngspice
CLOSED_LOOP = ("inverse", "least-squares", "ridge")
LINEAR = (
    *CLOSED_LOOP,
    "custom-matrix",  # with the noise of its sensors, which a transient does not have
    "eleven-channel",
    "known-readings",
    "paper-breadboard",
    "tuned-breadboard",
    "passive",
    "input-errors",
)
NONLINEAR = (
    "paper-exponential",
    "paper-exponential-devices",
    "tangential-exponential",
    "large-signal",
    "current-limit",
    "sinh",
    "softplus",
    "rectifier",
)
# What differs for a dialect are the kinds of parts: with every commit one board of each kind.
OTHERS = {
    *("least-squares", "ridge", "custom-matrix", "eleven-channel", "known-readings"),
    *("tuned-breadboard", "paper-exponential", "large-signal"),
}
DESIGN: dict[str, Any] = {"lambda": 0.05, "gain": "1Mohm", "unit_conductance": "2uS"}
LIMITED = {"base": "ua741", "level": "large-signal"}
MADE: dict[str, dict[str, Any]] = {
    "passive": {"lambda": 20.0, "topology": "passive"},
    "large-signal": {"opamp": LIMITED, "supply": 10.0},
    "current-limit": {"opamp": LIMITED | {"output_current": "50uA"}},
    "input-errors": {"opamp": {"base": "ua741", "input_errors": "typical"}},
    "sinh": {"amplifier": "sinh", "exponential_slope": 0.3},
    "softplus": {"amplifier": "softplus", "exponential_slope": 0.3},
    "rectifier": {"amplifier": "rectifier", "exponential_slope": 0.3, "ridge_share": 0.0},
}
STEPS = 1000
RUN = Transient(5e-6, 2.5e-8)


def boards(names: tuple[str, ...]) -> list[Any]:
    """Return names of boards, those of `OTHERS` for `make nightly`."""
    nightly = pytest.mark.nightly
    return [pytest.param(name, marks=nightly) if name in OTHERS else name for name in names]


def step_of(name: str) -> float:
    """Largest step (s): the fastest op-amp, an OPA189, has a bandwidth of 14 MHz.

    A closed-loop board follows it without a signal capacitor between.
    """
    return 1e-9 if name in CLOSED_LOOP else 1e-8


def scene_of(name: str) -> Scene:
    if name not in MADE:
        return load_scene(SCENES / f"{name}.toml")
    return make_scene({"channels": 3, "span": 2.0}, design=DESIGN | MADE[name])


def at_its_level(circuit: Circuit, name: str) -> Circuit:
    """The board with the limits of its op-amps, where it is to have them."""
    if name not in ("large-signal", "current-limit"):
        return circuit
    limited = {
        key: replace(model, large_signal=True, limits_current=name == "current-limit")
        for key, model in circuit.models.items()
    }
    return replace(circuit, models=limited)


def decks(name: str, *dialects: str, **options: Any) -> list[Deck]:
    scene = scene_of(name)
    circuit, step = at_its_level(synthesise(scene), name), step_of(name)
    transient = Transient(STEPS * step, step, initial=scene.analysis.initial)
    return [write_deck(circuit, transient, dialect=word, **options) for word in dialects]


@pytest.fixture(scope="module")
def native(ngspice: str, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Record]:
    """Return what ngspice finds of a board in its own dialect; each runs once."""

    @functools.cache
    def record(name: str) -> Record:
        (deck,) = decks(name, "ngspice")
        return ngspice_record(deck, tmp_path_factory.mktemp("native"))

    return record


@pytest.mark.parametrize("dialect", MODES)
@pytest.mark.parametrize("name", boards((*LINEAR, *NONLINEAR)))
def test_ngspice_reads_the_dialect_and_finds_the_same_waveforms(
    name: str, dialect: str, native: Callable[[str], Record], tmp_path: Path
) -> None:
    (foreign,) = decks(name, dialect)
    found = ngspice_record(foreign, tmp_path, MODES[dialect])
    assert found[0][-1] == pytest.approx(STEPS * step_of(name), rel=1e-9)
    assert distance(native(name), found) < 2e-4


@pytest.mark.parametrize("dialect", ["ngspice", "ltspice", "hspice", "xyce", "spectre"])
@pytest.mark.parametrize("name", boards(LINEAR))
def test_gnucap_finds_the_same_waveforms_of_linear_boards(
    name: str, dialect: str, native: Callable[[str], Record], gnucap: str
) -> None:
    (foreign,) = decks(name, dialect)
    assert distance(native(name), gnucap_record(gnucap, foreign)) < 3e-4


def test_every_part_of_an_ltspice_deck_is_what_spicelib_reads(tmp_path: Path) -> None:
    (deck,) = decks("paper-exponential-devices", "ltspice")
    (tmp_path / "deck.cir").write_text(deck.text)
    editor = SpiceEditor(str(tmp_path / "deck.cir"), encoding="utf-8")
    circuit = synthesise(scene_of("paper-exponential-devices"))
    expected = {f"R{part.name}": part.ohms for part in circuit.resistors}
    for matrix in circuit.matrices:
        for k, n, _, _, ohms in matrix.elements():
            expected[f"{matrix.name}_{k + 1}_{n + 1}"] = ohms
    found = {name: editor.get_component_floatvalue(name) for name in editor.get_components("R")}
    assert {name.upper(): value for name, value in expected.items()} == pytest.approx(
        {name.upper(): value for name, value in found.items()}, rel=1e-12
    )
    assert len(editor.get_components("X")) == len(circuit.opamps)
    assert len(editor.get_components("Q")) == len(circuit.transistors)


def test_a_source_that_begins_after_the_rest_is_a_wave_in_spectre() -> None:
    circuit = synthesise(scene_of("input-errors"))
    deck = write_deck(circuit, Transient(1e-5, 1e-8, initial="rest"), dialect="spectre")
    (wave,) = (line for line in deck.text.split("\n") if line.startswith("Ieps"))
    native = write_deck(circuit, Transient(1e-5, 1e-8, initial="rest")).text
    points = re.search(r"^Ieps_2 0 c_2 PWL\((.*)\)$", native, re.MULTILINE)
    assert points
    assert wave == f"Ieps_2 (0 c_2) isource type=pwl wave=[{points[1]}]"


def deck_of(name: str, **options: Any) -> Deck:
    read = scene_of(name)
    run = replace(RUN, initial=read.analysis.initial)
    return write_deck(synthesise(read), run, **options)


def with_analysis(circuit: Any, deck: Deck) -> Deck:
    """The text of a PySpice circuit as a deck, with the analysis of `deck`."""
    cards = [line for line in deck.text.split("\n") if line.startswith((".save", ".tran", ".end"))]
    last = [line for line in cards if not line.startswith(".ends")]
    return replace(deck, text="\n".join([str(circuit), *last, ""]))


@pytest.mark.parametrize("name", ["paper-breadboard", "paper-exponential-devices", "input-errors"])
def test_its_text_is_the_same_board(name: str, ngspice: str, tmp_path: Path) -> None:
    deck = deck_of(name)
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
    circuit = synthesise(scene_of(name))
    made = deck_of(name).to_pyspice()
    assert made.Rf_1_1.resistance == float(circuit.forward.ohms[0, 0])
    assert [cell.name for cell in made.subcircuits] == ["ideal_changed"]
    assert next(iter(made.subcircuits)).Ro.resistance == 75.0
    assert [model.name for model in made.models] == ["ssm2220"]
    assert str(made.Cc_1) == "Cc_1 v_1 x_1 4.7e-11"


def test_another_dialect_is_refused() -> None:
    with pytest.raises(ValueError, match="'hspice' has no PySpice circuit; expected ngspice"):
        deck_of("known-readings", dialect="hspice").to_pyspice()
