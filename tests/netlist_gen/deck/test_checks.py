"""Nothing but names and finite numbers gets into a deck."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit, Omission
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.netlist_gen.deck.part_tolerances import read_tolerances
from taction.system.errors import InputError
from tests.support.making import make_scene, matrix_problem

EVIL = "x\n.control\nshell true\n.endc\n*"
TRANSIENT = Transient(1e-3, 1e-6)


def small(**design: Any) -> Circuit:
    design = {"amplifier": "exponential", "stray_capacitance": "1pF", **design}
    return synthesise(make_scene(design=design), matrix_problem([[1.0, -1.0]], [1.0]))


def changed(circuit: Circuit, kind: str, **fields: Any) -> Circuit:
    first, *rest = getattr(circuit, kind)
    return replace(circuit, **{kind: (replace(first, **fields), *rest)})


def test_the_board_itself_passes() -> None:
    assert write_deck(small(), TRANSIENT).text.startswith(".title taction board\n")


@pytest.mark.parametrize("text", [EVIL, "a b", "1x", "", "a;b", "a$b", "a=1", "µ", "x\n"])
@pytest.mark.parametrize(
    ("kind", "field"),
    [
        ("opamps", "name"),
        ("opamps", "model"),
        ("opamps", "inverting"),
        ("resistors", "name"),
        ("resistors", "a"),
        ("capacitors", "b"),
        ("currents", "node"),
        ("voltages", "name"),
        ("amplifiers", "name"),
        ("amplifiers", "output"),
    ],
)
def test_a_name_that_is_no_name_is_refused(kind: str, field: str, text: str) -> None:
    with pytest.raises(ValueError, match="is not a valid name in a deck"):
        write_deck(changed(small(), kind, **{field: text}), TRANSIENT)


@pytest.mark.parametrize("kind", ["resistors", "capacitors", "opamps", "currents"])
def test_two_parts_of_one_name_are_refused(kind: str) -> None:
    parts = getattr(small(), kind)
    with pytest.raises(ValueError, match=f"two {kind} have the name {parts[0].name!r}"):
        write_deck(replace(small(), **{kind: (*parts, parts[0])}), TRANSIENT)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0, -1.0])
@pytest.mark.parametrize(
    ("kind", "field"),
    [
        ("resistors", "ohms"),
        ("capacitors", "farads"),
        ("amplifiers", "u_scale"),
        ("amplifiers", "v_scale"),
    ],
)
def test_a_value_that_no_part_has_is_refused(kind: str, field: str, value: float) -> None:
    with pytest.raises(ValueError, match="must be finite and above zero"):
        write_deck(changed(small(), kind, **{field: value}), TRANSIENT)


@pytest.mark.parametrize("value", [float("nan"), 0.0, -1.0])
def test_a_matrix_holds_resistors_only(value: float) -> None:
    circuit = small()
    matrix = replace(circuit.forward, ohms=np.array([[1.0, value]]))
    with pytest.raises(ValueError, match="not above zero"):
        write_deck(replace(circuit, matrices=(matrix, circuit.feedback)), TRANSIENT)


@pytest.mark.parametrize(
    "fields",
    [
        {"name": EVIL},
        {"name": "a b"},
        {"amplifier": EVIL},
        {"topology": EVIL},
        {"omissions": (Omission(EVIL, "why"),)},
        {"omissions": (Omission("what", "why\nR1 a b 1"),)},
    ],
)
def test_the_header_holds_no_line_of_its_own(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"not a valid name|comment line"):
        write_deck(replace(small(), **fields), TRANSIENT)


@pytest.mark.parametrize(
    "changes",
    [
        {"analysis": Transient(float("nan"), 1e-6)},
        {"analysis": Transient(1e-3, float("inf"))},
        {"analysis": Transient(-1e-3, 1e-6)},
        {"analysis": Transient(1e-3, 1e-6, voltages={EVIL: 1.0})},
        {"analysis": Transient(1e-3, 1e-6, voltages={"v_1": float("nan")})},
        {"saved": [EVIL]},
        {"saved": ["v_1) v(2"]},
        {"solver": EVIL},
        {"matrix_file": EVIL},
        {"matrix_file": "../matrix.inc"},
        {"matrix_file": "a b.inc"},
    ],
)
def test_what_a_deck_asks_for_is_checked_too(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"not a valid name|a file name in a deck|finite"):
        write_deck(small(), **{"analysis": TRANSIENT, **changes})


CARDS = (
    "v1 in 0 1", "r1 in a 1k", "rf a out 1k", "c1 out 0 1n", "l1 out 0 1u", "l2 a 0 1u",
    "k1 l1 l2 0.5", "e1 b 0 a 0 2", "r.x1.rin a 0 1meg", "c.x1.c1 a 0 1p", "c.x2.c1 out 0 1p",
)  # fmt: skip


@pytest.fixture(scope="module")
def circuit() -> Circuit:
    return circuit_of(read_cards(CARDS), "deck", ["out"])


def tolerances(text: str, circuit: Circuit, folder: Path) -> dict[str, float]:
    place = folder / "parts.toml"
    place.write_text(text)
    return read_tolerances(place, circuit).parts.parts


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('resistor = "1%"', {"R1": 0.01, "Rf": 0.01}),
        ("[tolerances]\ncapacitor = 0.05", {"C1": 0.05}),
        ('coil = "2 %"\ngain = 0.1', {"L1": 0.02, "L2": 0.02, "E1": 0.1}),
        ('coupling = "1%"', {"K1": 0.01}),
        ('[parts]\n"x*.c1" = "30%"', {"x1.C1": 0.3, "x2.C1": 0.3}),
        ('resistor = "1%"\n[parts]\nRF = 0', {"R1": 0.01}),
        ('[parts]\n"x1.*" = 0.2\n"x1.Rin" = 0.5', {"x1.Rin": 0.5, "x1.C1": 0.2}),
    ],
)
def test_kinds_and_names(
    text: str, parts: dict[str, float], circuit: Circuit, tmp_path: Path
) -> None:
    """A kind counts outside of subcircuits; a later name overrides an earlier one."""
    assert tolerances(text, circuit, tmp_path) == parts


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("resistors = 0.01", ("resistors", "'resistor'")),
        ('resistor = "1k"', ("resistor", "'1k'", '"5%"')),
        ("resistor = true", ("resistor", "True")),
        ("resistor = -0.1", ("resistor", "-0.1")),
        ("resistor = nan", ("resistor", "nan")),
        ("resistor = 1e300", ("resistor", "1e+300")),
        ("parts = 3", ("parts", "table")),
        ("[parts]\nR9 = 0.1", ("parts.R9", "the nearest is")),
        ("[parts]\nK9 = 0.1", ("parts.K9", "no part")),
        ("coupling = 1", ("K1", "reaches 1")),
        ('distribution = "flat"', ("distribution", "'normal' or 'uniform'")),
        ("", ("nothing varies", "[parts]")),
        ("resistor 1", ("line 1",)),
        ("tolerances = 3", ("tolerances", "TOML")),
    ],
)
def test_mistakes_name_key_value_and_what_is_accepted(
    text: str, words: tuple[str, ...], circuit: Circuit, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as error:
        tolerances(text, circuit, tmp_path)
    for word in ("parts.toml", *words):
        assert word in str(error.value)
