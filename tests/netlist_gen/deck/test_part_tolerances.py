"""Tolerances of a deck's parts: which parts a file names, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.netlist_gen.deck.part_tolerances import read_tolerances
from taction.system.errors import InputError

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
