"""A deck that says what its circuit says is read back as such; any changed card is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

import taction
from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.design import Design
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.topologies.frame.table import TOPOLOGIES
from taction.system.errors import InputError
from tests.support.deck_read_back import unlike
from tests.support.paths import SCENES
from tests.support.scenes_of_all_kinds import random_scene

SHIPPED = sorted(SCENES.glob("*.toml"))
TRANSIENT = Transient(1e-3, 1e-6)


def text_of(circuit: Circuit, transient: Transient = TRANSIENT) -> str:
    return write_deck(circuit, transient).text


@pytest.mark.parametrize("initial", ["zero", "rest"])
def test_the_decks_of_all_kinds_of_boards_say_what_their_circuits_say(initial: str) -> None:
    read = 0
    for seed in range(120):
        try:
            circuit = synthesise(random_scene(seed))
        except InputError:
            continue
        deck = text_of(circuit, replace(TRANSIENT, initial=initial))  # type: ignore[arg-type]
        assert unlike(circuit, deck) == "", seed
        read += 1
    assert read > 100


@pytest.mark.parametrize("scene", SHIPPED, ids=lambda path: path.stem)
def test_the_decks_of_the_shipped_scenes_say_what_their_circuits_say(scene: Path) -> None:
    circuit = synthesise(load_scene(scene))
    assert unlike(circuit, text_of(circuit)) == ""


@pytest.mark.parametrize("way", get_args(Design.model_fields["negative_entries"].annotation))
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_the_decks_of_all_topologies_say_what_their_circuits_say(topology: str, way: str) -> None:
    given: dict[str, Any] = {} if topology in ("inv", "pinv") else {"lam": 2.0}
    for wires in ({}, {"word_line": 30.0, "sense": 5.0}):
        scene = taction.Scene.from_arrays(
            [[1.0, 0.4], [0.4, -1.0]], [0.4, 0.2], topology=topology, negative_entries=way,
            wires=wires, **given,
        )  # fmt: skip
        circuit = synthesise(scene)
        assert unlike(circuit, text_of(circuit)) == ""


@pytest.mark.parametrize("name", OPAMPS)
@pytest.mark.parametrize("topology", ["integrator", "passive"])
def test_the_subcircuit_of_every_preset_responds_as_its_model(name: str, topology: str) -> None:
    scene = taction.Scene.from_arrays(
        [[1.0, 0.4], [0.4, -1.0]], [0.4, 0.2], topology=topology, unit_conductance="2uS",
        lam=5.0, opamp={"base": name, "input_errors": "typical"}, supply="2.5V",
    )  # fmt: skip
    try:
        circuit = synthesise(scene)
    except InputError as error:
        assert "works at supplies" in str(error)  # noqa: PT017 - of some presets
        circuit = synthesise(scene.model_copy(update={"design": scene.design.model_copy(
            update={"supply": 15.0})}))  # fmt: skip
    assert unlike(circuit, text_of(circuit)) == ""


CHANGES = {
    "the last digit of a resistor": ("Rr_1 v_1 x_1 2499999.9999999995", "Rr_1 v_1 x_1 2.5e6"),
    "a node": ("Cstray_c_5 c_5 0", "Cstray_c_5 c_6 0"),
    "a card left out": ("Cc_2 v_2 x_2 1e-10\n", ""),
    "a card more": ("Cc_2 v_2 x_2 1e-10\n", "Cc_2 v_2 x_2 1e-10\nCd_2 v_2 x_2 1e-13\n"),
    "a card twice": ("Cc_2 v_2 x_2 1e-10\n", 2 * "Cc_2 v_2 x_2 1e-10\n"),
    "a strain": ("Ieps_3 0 c_3", "Ieps_3 c_3 0"),
    "both inputs of an op-amp": ("Xc_5 0 c_5 w_5", "Xc_5 c_5 0 w_5"),
    "the model of an op-amp": ("Xc_5 0 c_5 w_5 opa189", "Xc_5 0 c_5 w_5 opa188"),
    "the pins of the subcircuit": ("opa189 inp inn out", "opa189 inn inp out"),
    "an entry of the matrix": ("Rb_1_2 z_1 x_2 161290", "Rb_1_2 z_1 x_2 161291"),
    "the gain of the op-amp": ("G1 0 p1 inpd inn 0.00101572", "G1 0 p1 inpd inn 0.00101573"),
    "its offset": ("Vos inpo inp 4e-07", "Vos inpo inp 4.001e-07"),
    "its bias current": ("Ibn inn 0 -7e-11", "Ibn inn 0 -7.01e-11"),
    "its rejection": ("inpo inn 0 1.99", "inpo inn 0 9.99"),
    "its input resistance": ("Rd inp inn 100000000.0", "Rd inp inn 100001000.0"),
    "its output resistance": ("Ro e out 380.0", "Ro e out 380.0001"),
    "its second pole": ("C2 p2 0 1e-11\n", ""),
    "a card that cannot be read": ("C2 p2 0 1e-11\n", "C2 p2 0\n"),
    "two sources at one node": ("Eo e 0 p2 0 1.0\n", "Eo e 0 p2 0 1.0\nEe e 0 p1 0 2.0\n"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_card_is_found(change: str) -> None:
    circuit = synthesise(load_scene(SCENES / "custom-matrix.toml"))
    deck, (old, new) = text_of(circuit), CHANGES[change]
    assert deck.count(old) >= 1
    assert unlike(circuit, deck.replace(old, new, 1)) != ""


def test_transistors_and_stages_are_compared() -> None:
    devices = synthesise(load_scene(SCENES / "paper-exponential-devices.toml"))
    deck = text_of(devices)
    (name,) = devices.transistor_models
    assert unlike(devices, deck.replace(" bf=", " bf=1")) == (
        f"the model {name} has other figures in the deck than in the circuit"
    )
    assert unlike(devices, deck.replace(f".model {name} ", f".model {name}2 ")) != ""
    stages = synthesise(load_scene(SCENES / "paper-exponential.toml"))
    assert "a_3_x 0 v_3 0" in text_of(stages)
    assert unlike(stages, text_of(stages).replace("a_3_x 0 v_3 0", "a_3_x 0 v_4 0")).startswith(
        "Exa_3 is a_3_x 0 v_4 0 10.0 in the deck"
    )
    assert unlike(stages, text_of(stages).replace("exp(min(V(a_3_x)", "exp(min(V(a_2_x)"))


def test_the_message_names_the_card_with_both_values() -> None:
    circuit = synthesise(load_scene(SCENES / "custom-matrix.toml"))
    other = replace(circuit, capacitors=circuit.capacitors[1:])
    found = unlike(other, text_of(circuit))
    first = circuit.capacitors[0]
    assert found.startswith(f"{first.card} is {first.a} {first.b} {first.farads!r} in the deck")
    assert found.endswith("missing in the circuit")
