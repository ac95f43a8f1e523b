"""What a board states about itself: roles, facts, knobs, and boards with a knob turned."""

from __future__ import annotations

import pytest

from taction.netlist_gen.board.circuit import Circuit, Role, common_facts
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.verification.stability.families import scaled_parts
from tests.support.making import make_scene

DESIGN = {"capacitance": "10pF", "resistance": "2Mohm", "gain": "1Mohm"}


def board(topology: str = "integrator", **design: object) -> Circuit:
    tables = {**DESIGN, "topology": topology, "opamp": "ua741", **design}
    return synthesise(make_scene({"channels": 3}, design=tables))


@pytest.mark.parametrize("topology", ["integrator", "passive"])
def test_every_part_has_a_role(topology: str) -> None:
    circuit = board(topology, unit_conductance="1nS")
    stated = [name for names in circuit.roles.values() for name in names]
    parts = [part.card for part in (*circuit.resistors, *circuit.capacitors)]
    assert sorted(stated) == sorted([*parts, "Rf", "Rb"])
    assert len(circuit.capacitors_of(Role.SIGNAL_CAPACITOR)) == 3
    assert len(circuit.resistors_of(Role.CONSTRAINT_RESISTOR)) == 3
    assert len(circuit.real_capacitors) == 3
    assert circuit.shape == (3, 3)
    assert (circuit.forward.name, circuit.feedback.name) == ("Rf", "Rb")
    assert next(circuit.feedback.resistors()).card == "Rb_1_1"


def test_facts_have_their_number_and_their_text() -> None:
    circuit = board()
    assert list(circuit.facts) == ["G0", "U0", "R", "C", "gain", "lambda"]
    assert circuit.value("R") == 2e6
    assert circuit.facts["gain"].text == "1 MΩ"
    assert circuit.facts["gain"].label.endswith(" s")
    exponential = board(amplifier="exponential", exponential_slope="70mV")
    assert exponential.value("Ve") == 0.07
    assert common_facts(C=1e-12)["C"].key == "design.capacitance"


def values(circuit: Circuit) -> dict[str, float]:
    resistors = {part.card: part.ohms for part in circuit.resistors}
    return resistors | {part.card: part.farads for part in circuit.capacitors}


@pytest.mark.parametrize("topology", ["integrator", "passive"])
@pytest.mark.parametrize(("name", "value"), [("C", 3e-12), ("gain", 3e6)])
def test_a_turned_knob_is_the_board_of_the_other_scene(
    topology: str, name: str, value: float
) -> None:
    circuit = board(topology, unit_conductance="1nS")
    knob = circuit.knob(name)
    scene = make_scene(
        {"channels": 3},
        design={**DESIGN, "topology": topology, "opamp": "ua741", "unit_conductance": "1nS"},
    )
    other, turned = synthesise(with_values(scene, {knob.key: value})), circuit.turned(name, value)
    assert values(turned) == pytest.approx(values(other), rel=1e-12)
    for fact in other.facts.values():
        assert turned.value(fact.name) == pytest.approx(fact.value, rel=1e-12)
    assert scaled_parts(circuit, [knob]) != scaled_parts(turned, [knob])
