"""Elements of a PySpice netlist that are lines of text.

PySpice's own elements make an object of every pin and look up every parameter they might have: 15
µs each, where an object that is one line takes 1, and a line among others a third of that. On a
board of 256 channels, whose 4096 parts stand beside 131,072 resistors, PySpice's own would be half
the time that a deck takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
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
    # What PySpice's own initialisation gives every object through a slow `__setattr__`.
    raw_spice = ""
    enabled = True
    _pins = ()
    name = property(attrgetter("_name"))

    def __init__(self, netlist: Any, name: str, *fields: str) -> None:
        own = self.__dict__
        own["_netlist"], own["_name"], own["_line"] = netlist, name, " ".join((name, *fields))
        netlist._add_element(self)

    def __str__(self) -> str:
        line: str = self._line
        return line


class Cards(Card):
    """Many lines of a netlist, in their place among PySpice's elements.

    Parameters
    ----------
    netlist : PySpice.Spice.Netlist.Netlist
        Where they are added, unless there are none.
    lines : sequence of str
        Each begins with the name of its part.

    Raises
    ------
    NameError
        Two lines have one name.
    """

    def __init__(self, netlist: Any, lines: Sequence[str]) -> None:
        if not lines:
            return
        names = [line.partition(" ")[0] for line in lines]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise NameError(f"two parts have the name {twice}")
        super().__init__(netlist, names[0])
        self.__dict__["_line"] = "\n".join(lines)
