"""Lines of text among PySpice's elements."""

from __future__ import annotations

import pytest
from PySpice.Spice.Netlist import Circuit

from spice_models.card import Card, Cards


def test_lines_stand_where_they_were_added() -> None:
    netlist = Circuit("title")
    Card(netlist, "R1", "a", "0", "1.0")
    Cards(netlist, ["C1 a 0 1e-12", "C2 a 0 1e-12"])
    Cards(netlist, [])
    Card(netlist, "V1", "a", "0", "1.0")
    expected = ["R1 a 0 1.0", "C1 a 0 1e-12", "C2 a 0 1e-12", "V1 a 0 1.0"]
    assert str(netlist).split("\n")[-5:] == [*expected, ""]


def test_a_name_is_given_once() -> None:
    netlist = Circuit("title")
    with pytest.raises(NameError, match="the name R1"):
        Cards(netlist, ["R1 a 0 1.0", "R2 a 0 1.0", "R1 b 0 1.0"])
    Card(netlist, "R1", "a", "0", "1.0")
    with pytest.raises(NameError):
        Card(netlist, "R1", "a", "0", "1.0")
