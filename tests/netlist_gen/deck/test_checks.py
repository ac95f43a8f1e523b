"""Nothing but names and finite numbers gets into a deck."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit, Omission
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
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
