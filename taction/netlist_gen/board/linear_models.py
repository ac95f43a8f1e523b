"""The linear parts of vendors' op-amps in the place of their cells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import Capacitor, OpAmpCell, Resistor
from taction.spice_models.branches import CONTROLS, Branch


def with_parts(circuit: Circuit, parts: Iterable[Branch]) -> Circuit:
    """Return a circuit with further linear parts."""
    every = [*parts]
    resistors = (Resistor(p.name, p.a, p.b, p.value) for p in every if p.letter == "R")
    capacitors = (Capacitor(p.name, p.a, p.b, p.value) for p in every if p.letter == "C")
    return replace(
        circuit,
        resistors=(*circuit.resistors, *resistors),
        capacitors=(*circuit.capacitors, *capacitors),
        branches=(*circuit.branches, *(part for part in every if part.letter not in "RC")),
    )


def with_linear_models(circuit: Circuit) -> Circuit:
    """Return a circuit with linear parts in the place of imported op-amps that have them."""
    parts, own = list[Branch](), list[OpAmpCell]()
    for cell in circuit.opamps:
        model = circuit.linear_model(cell)
        if model is None:
            own.append(cell)
        else:
            parts += [_placed(part, cell) for part in model.parts]
    return replace(with_parts(circuit, parts), opamps=tuple(own))


def _placed(part: Branch, cell: OpAmpCell) -> Branch:
    """Return a part of one op-amp of the board, with nodes and cards of its own."""
    ports = {GROUND: GROUND, "inp": cell.noninverting, "inn": cell.inverting, "out": cell.output}

    def node(name: str) -> str:
        return ports.get(name) or f"x{cell.name}.{name}"

    def card(name: str) -> str:
        return f"{name}.x{cell.name}"

    end = card if part.letter == "K" else node
    control = card if CONTROLS.get(part.letter) == 1 else node
    ends = end(part.a), end(part.b)
    return Branch(
        part.letter, card(part.name), *ends, part.value, tuple(map(control, part.control))
    )
