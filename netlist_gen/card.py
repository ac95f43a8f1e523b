"""An element of a PySpice netlist that is one line of text.

PySpice's own elements make an object of every pin and look up every parameter they might have: 15
µs each. On a board of 256 channels, whose 4096 parts stand beside 131,072 resistors, that is half
the time that a deck takes.
"""

from __future__ import annotations

from typing import Any

from PySpice.Spice.Netlist import Element


class Card(Element):  # type: ignore[misc]  # PySpice has no types
    """One line of a netlist, in its place among PySpice's elements.

    Parameters
    ----------
    netlist : PySpice.Spice.Netlist.Netlist
        Where it is added.
    name : str
        With the letter of its kind, such as ``Rin_3``.
    fields : str
        Nodes, model and value, as they are printed.

    Raises
    ------
    NameError
        `netlist` has an element of this name.
    """

    PREFIX = ""

    def __init__(self, netlist: Any, name: str, *fields: str) -> None:
        super().__init__(netlist, name)
        self._line = " ".join((name, *fields))

    def __str__(self) -> str:
        return self._line
