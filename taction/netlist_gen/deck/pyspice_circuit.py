"""A deck of ngspice as PySpice's `Circuit`, with every part as an object that can be changed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import Circuit

_CELL = re.compile(r"^\.subckt (\S+).*\n((?:.*\n)*?)\.ends \1\n", re.M)
_CAPACITOR = re.compile(r"^C(\S+) (\S+) (\S+) (\S+)\n", re.M)
VALUES = ("resistance", "voltage_gain", "transconductance", "dc_value")
_FOREIGN = re.compile(r"^[^RCIVEGBXQ]", re.M)  # a card that taction does not write


def pyspice_circuit(text: str, files: Mapping[str, str]) -> Circuit:
    """Return the parts, models and options of a deck of ngspice, by PySpice's parser.

    The analysis, what is saved and what is measured are left to PySpice's simulator. A subcircuit
    with cards that taction does not write, a vendor's, stays text (``raw_spice``).
    """
    from PySpice.Spice.Parser import SpiceParser

    for name, inner in files.items():
        text = text.replace(f".include {name}\n", inner)
    kept = [cell[0] for cell in _CELL.finditer(text) if _FOREIGN.search(cell[2])]
    for vendors in kept:
        text = text.replace(vendors, "")
    parser = SpiceParser(source=_CAPACITOR.sub("", text))  # it takes them for expressions
    circuit, cells = parser.build_circuit(), {cell[1]: cell[2] for cell in _CELL.finditer(text)}
    netlists = [(circuit, _CELL.sub("", text))]
    for statement in parser.subcircuits:
        circuit.subcircuit(cell := statement.build())
        netlists.append((cell, cells[cell.name]))
    for netlist, cards in netlists:
        for name, a, b, farads in _CAPACITOR.findall(cards):
            netlist.C(name, a, b, float(farads))
        for element in netlist.elements:
            for key in VALUES:
                with suppress(AttributeError, ValueError):  # another part, or a waveform
                    setattr(element, key, float(getattr(element, key)))
    options = (line + "\n" for line in text.split("\n") if line.startswith(".options"))
    circuit.raw_spice += "".join((*kept, *options))
    return circuit
