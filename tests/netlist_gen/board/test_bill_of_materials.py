"""The parts of a board: every part once, equal values together, packages, preferred values."""

from __future__ import annotations

import re
from typing import Any

import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.bill_of_materials import BillOfMaterials, bill_of_materials
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from tests.support.making import make_scene, matrix_problem

T = [[1.0, 0.0, -0.5], [2.0, 0.4, 1.0]]
DESIGN = {"unit_conductance": "10uS", "resistance": "1Mohm", "gain": "100kohm"}


def parts_of(tables: dict[str, Any] | None = None, **design: Any) -> BillOfMaterials:
    scene = make_scene(design=DESIGN | design, **(tables or {}))
    return bill_of_materials(synthesise(scene, matrix_problem(T, [1.0, 2.0])), scene)


@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
def test_every_resistor_and_c_of_the_deck_is_listed_once(amplifier: str) -> None:
    scene = make_scene(design=DESIGN | {"amplifier": amplifier})
    circuit = synthesise(scene, matrix_problem(T, [1.0, 2.0]))
    deck = write_deck(circuit, Transient(1e-3, 1e-6)).text
    body = re.sub(r"^\.subckt.*?^\.ends", "", deck, flags=re.MULTILINE | re.DOTALL)
    cards = dict(re.findall(r"^([RC]\w+) \w+ \w+ ([-+.e\d]+)$", body, re.MULTILINE))
    wanted = {name: float(value) for name, value in cards.items() if "stray" not in name}
    lines = bill_of_materials(circuit, scene).lines
    listed = [name for line in lines for name in line.references]
    assert len(listed) == len(set(listed))
    found = {name: line.value for line in lines for name in line.references}
    assert found == pytest.approx(wanted, rel=1e-9, abs=0.0)


def test_equal_values_are_one_line() -> None:
    """1/(T G0): 50, 100 (twice as T = 1, and s), 200 and 250 kohm; R is 1 Mohm."""
    lines = {line.value: line for line in parts_of().lines if line.kind == "resistor"}
    assert sorted(lines) == pytest.approx([1e4, 5e4, 1e5, 2e5, 2.5e5, 1e6])
    hundred = next(line for value, line in lines.items() if value == pytest.approx(1e5))
    names = {"Rs_1", "Rs_2", "Rf_1_1", "Rf_2_3", "Rb_1_1", "Rb_2_3"}
    assert set(hundred.references) == names


def test_what_is_no_standard_value_comes_with_the_nearest() -> None:
    near = {line.value: line.preferred for line in parts_of(gain="101.5kohm").lines}
    assert near[1e6] is None
    found = near[101.5e3]
    assert found is not None
    assert (found.series, found.value) == ("E96", 102e3)  # E24 has 100 and 110, E96 100 and 102
    assert found.deviation == pytest.approx(0.5 / 101.5)
    capacitors = {line.kind: line.preferred for line in parts_of(capacitance="10.2pF").lines}
    found = capacitors["capacitor"]
    assert found is not None
    assert (found.series, found.value) == ("E24", 1e-11)


@pytest.mark.parametrize("series", ["E24", "E96", "E192"])
def test_a_board_from_a_series_has_standard_values_only(series: str) -> None:
    lines = parts_of(resistor_series=series, gain="123.4kohm", resistance="777kohm").lines
    assert [line.value for line in lines if line.preferred] == []


@pytest.mark.parametrize(
    ("opamp", "packages", "spare"), [("ua741", 9, 0), ("lf353", 5, 1), ("tl084", 3, 3)]
)
def test_packages(opamp: str, packages: int, spare: int) -> None:
    """Three v, three inverters of u (each has a positive entry), two w and one inverter of w."""
    parts = parts_of(opamp=opamp)
    held = [name for package in parts.packages for name in package.opamps]
    names = ["v_1", "v_2", "v_3", "a_1", "a_2", "a_3", "c_1", "z_1", "c_2"]
    assert sorted(held) == sorted(names)
    assert (len(parts.packages), parts.spare) == (packages, spare)
    assert parts.packages[0].reference == "U1"


def test_what_the_list_lacks_is_said() -> None:
    text = "\n".join(
        parts_of(amplifier="exponential", opamp={"base": "ideal", "gbw": 1e6}).not_listed
    )
    for part in (
        "scene's gbw, which ideal",
        "supply_current",
        "2 current sources",
        "bias",
        "±15 V",
    ):
        assert part in text
    assert "3 exponential amplifiers" in text
    assert "9 times the compensation capacitor of 22 pF" in parts_of(opamp="ne5534").not_listed[0]
    assert "supply_current" not in "\n".join(parts_of().not_listed)
