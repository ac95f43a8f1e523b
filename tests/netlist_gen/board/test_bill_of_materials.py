"""The parts of a board: every part once, equal values together, packages, preferred values."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.bill_of_materials import (
    BillOfMaterials,
    bill_of_materials,
    buyable,
    mantissas,
    nearest,
)
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from tests.support.making import make_scene, matrix_problem

T = [[1.0, 0.0, -0.5], [2.0, 0.4, 1.0]]
DESIGN = {"unit_conductance": "10uS", "resistance": "1Mohm", "gain": "100kohm"}
# Every eighth value of E96 and every sixteenth of E192, as the standard's tables print them.
E12 = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2)  # IEC 60063
E96 = [1.00, 1.21, 1.47, 1.78, 2.15, 2.61, 3.16, 3.83, 4.64, 5.62, 6.81, 8.25]
E192_LAST = [8.56, 8.66, 8.76, 8.87, 8.98, 9.09, 9.20, 9.31, 9.42, 9.53, 9.65, 9.76, 9.88]


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


def test_values_of_the_standard() -> None:
    assert mantissas("E6").tolist() == [1.0, 1.5, 2.2, 3.3, 4.7, 6.8]
    assert mantissas("E12").tolist() == [1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2]
    assert mantissas("E96")[::8].tolist() == E96
    assert mantissas("E192")[-13:].tolist() == E192_LAST
    assert mantissas("E192")[::2].tolist() == mantissas("E96").tolist()
    for value in (2.7, 3.0, 3.3, 3.6, 3.9, 4.3, 4.7, 8.2):  # not where 10^(k/24) would round to
        assert value in mantissas("E24")


@pytest.mark.parametrize("decade", range(-14, 10))
def test_a_preferred_value_is_itself_in_every_decade(decade: int) -> None:
    for series in ("E6", "E12", "E24", "E96", "E192"):
        ohms = np.array([float(f"{m}e{decade}") for m in mantissas(series).tolist()])
        assert np.array_equal(nearest(ohms, series), ohms)


@given(st.floats(1e-3, 1e9), st.sampled_from(["E24", "E96", "E192"]))
def test_no_other_preferred_value_is_nearer_by_ratio(ohms: float, series: str) -> None:
    found = float(nearest(np.array([ohms]), series)[0])
    every = np.outer(10.0 ** np.arange(-4, 11), mantissas(series)).ravel()
    best = float(np.min(np.abs(np.log(every / ohms))))
    assert abs(np.log(found / ohms)) <= best + 1e-12


@pytest.mark.parametrize(
    ("value", "series", "expected"),
    [(5.1e-12, "E12", 4.7e-12), (5.2e-12, "E12", 5.6e-12), (12.345, "exact", 12.3)],
)
def test_the_nearest(value: float, series: str, expected: float) -> None:
    assert buyable(value, series) == expected
