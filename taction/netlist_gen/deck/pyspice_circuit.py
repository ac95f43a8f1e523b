"""A deck of ngspice as PySpice's `Circuit`, with every part as an object that can be changed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import chain
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import Circuit, Netlist

_MODEL = re.compile(r"\.model (\w+) (\w+)\((.*)\)")
_ANALYSES = {".title", ".save", ".tran", ".op", ".meas", ".noise", ".ic", ".end"}
_TWO_ENDED = {"R": "R", "C": "C", "I": "I", "V": "V"}  # letter of a card: method of a netlist
_CONTROLLED = {"E": ("VCVS", "voltage_gain"), "G": ("VCCS", "transconductance")}
_PARTS = {*_TWO_ENDED, *_CONTROLLED, "B", "X", "Q"}


def pyspice_circuit(text: str, files: Mapping[str, str]) -> Circuit:
    """Return the parts, models and options of a deck of ngspice.

    The analysis, what is saved and what is measured are left to PySpice's simulator. A subcircuit
    with cards that taction does not write, a vendor's, stays text (``raw_spice``).
    """
    from PySpice.Spice.Netlist import Circuit, SubCircuit

    circuit = Circuit("taction board")
    included = (
        files[line.split()[1]].split("\n") if line.startswith(".include ") else [line]
        for line in text.split("\n")
    )
    lines = chain.from_iterable(included)
    for line in lines:
        words = line.split()
        if not words or line.startswith("*"):
            continue
        if words[0] == ".subckt":
            body = list(iter(lambda: next(lines), f".ends {words[1]}"))
            if all(card[:1] in _PARTS for card in body):
                cell = SubCircuit(words[1], *words[2:])
                _add_parts(cell, body)
                circuit.subcircuit(cell)
            else:
                circuit.raw_spice += "\n".join([line, *body, f".ends {words[1]}", ""])
        elif found := _MODEL.fullmatch(line):
            figures = dict(figure.split("=") for figure in found[3].split())
            circuit.model(found[1], found[2], **figures)
        elif line[0] in _PARTS:
            _add_parts(circuit, [line])
        elif words[0] not in _ANALYSES:
            circuit.raw_spice += line + "\n"
    return circuit


def _add_parts(netlist: Netlist, lines: Iterable[str]) -> None:
    for line in lines:
        kind, (name, *words) = line[0], line[1:].split()
        if kind in _TWO_ENDED:
            value = _number(" ".join(words[2:]))
            getattr(netlist, _TWO_ENDED[kind])(name, *words[:2], value)
        elif kind in _CONTROLLED:
            method, figure = _CONTROLLED[kind]
            getattr(netlist, method)(name, *words[:4], **{figure: _number(words[4])})
        elif kind == "B":
            expression = line.split(None, 3)[3].partition("=")[2]
            netlist.BehavioralSource(name, *words[:2], voltage_expression=expression)
        elif kind == "X":
            netlist.X(name, words[-1], *words[:-1])
        else:
            netlist.Q(name, *words[:3], model=words[3])


def _number(text: str) -> Any:
    """Return a value as a number, or as the text of an expression or a waveform."""
    try:
        return float(text)
    except ValueError:
        return text
