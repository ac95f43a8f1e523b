"""The linear parts of vendors' op-amps in the place of their cells, and their records in files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from taction.netlist_gen.board.branches import (
    BranchCoupling,
    ByCurrent,
    ByVoltage,
    ChargeByVoltage,
    Coil,
    CurrentBetween,
    CurrentByCurrent,
    CurrentByVoltage,
    Source,
    VoltageBetween,
    VoltageByCurrent,
    VoltageByVoltage,
)
from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import Branch, Capacitor, OpAmpCell, Resistor
from taction.spice_models.imported import LinearPart

KINDS: dict[str, type[Branch]] = {
    kind.letter: kind
    for kind in (
        BranchCoupling,
        ChargeByVoltage,
        Coil,
        CurrentBetween,
        CurrentByCurrent,
        CurrentByVoltage,
        VoltageBetween,
        VoltageByCurrent,
        VoltageByVoltage,
    )
}


def record_of(part: Resistor | Capacitor | Branch) -> LinearPart:
    """Return a part as a record of a file."""
    if isinstance(part, Resistor):
        return LinearPart(part.letter, part.name, part.a, part.b, part.ohms)
    if isinstance(part, Capacitor):
        return LinearPart(part.letter, part.name, part.a, part.b, part.farads)
    control: tuple[str, ...] = ()
    if isinstance(part, ByVoltage):
        control = part.control
    elif isinstance(part, ByCurrent):
        control = (part.control,)
    return LinearPart(part.letter, part.name, part.a, part.b, part.value, control)


def part_of(record: LinearPart) -> Resistor | Capacitor | Branch:
    """Return the part of a record."""
    name, a, b, value = record.name, record.a, record.b, record.value
    if record.letter == Resistor.letter:
        return Resistor(name, a, b, value)
    if record.letter == Capacitor.letter:
        return Capacitor(name, a, b, value)
    kind = KINDS[record.letter]
    if issubclass(kind, Source):
        return kind(name, a, b, value, value)
    if issubclass(kind, ByVoltage):
        return kind(name, a, b, value, (record.control[0], record.control[1]))
    if issubclass(kind, ByCurrent):
        return kind(name, a, b, value, record.control[0])
    return kind(name, a, b, value)


def check_parts(records: Iterable[LinearPart]) -> None:
    """Raise ValueError for a record of a file with a kind, control or value that no part has."""
    every = tuple(records)
    cards = {record.letter + record.name for record in every}
    if len(cards) < len(every):
        raise ValueError("linear.parts: expected a name of its own for each part")
    for record in every:
        where = f"linear.parts: {record.letter + record.name!r}"
        if record.letter not in (Resistor.letter, Capacitor.letter, *KINDS):
            raise ValueError(f"{where}: expected one of {' '.join('RC' + ''.join(KINDS))}")
        if record.letter in "RL" and record.value == 0.0:
            raise ValueError(f"{where}: expected a value other than 0")
        wanted = {"E": 2, "G": 2, "Y": 2, "F": 1, "H": 1}.get(record.letter, 0)
        if len(record.control) != wanted:
            raise ValueError(f"{where}: expected {wanted} controls")
        known: tuple[str, ...] = record.control if record.letter in "FH" else ()
        known = (record.a, record.b) if record.letter == "K" else known
        if lacking := [card for card in known if card not in cards]:
            raise ValueError(f"{where}: there is no part {lacking[0]!r}")


def with_linear_models(circuit: Circuit) -> Circuit:
    """Return a circuit with linear parts in the place of imported op-amps that have them."""
    resistors, capacitors = list(circuit.resistors), list(circuit.capacitors)
    branches, own = list(circuit.branches), list[OpAmpCell]()
    for cell in circuit.opamps:
        model = circuit.linear_model(cell)
        if model is None:
            own.append(cell)
            continue
        for record in model.parts:
            part = part_of(_placed(record, cell))
            if isinstance(part, Resistor):
                resistors.append(part)
            elif isinstance(part, Capacitor):
                capacitors.append(part)
            else:
                branches.append(part)
    return replace(
        circuit,
        opamps=tuple(own),
        resistors=tuple(resistors),
        capacitors=tuple(capacitors),
        branches=tuple(branches),
    )


def _placed(record: LinearPart, cell: OpAmpCell) -> LinearPart:
    """Return a part of one op-amp of the board, with nodes and cards of its own."""
    ports = {GROUND: GROUND, "inp": cell.noninverting, "inn": cell.inverting, "out": cell.output}

    def node(name: str) -> str:
        return ports.get(name) or f"x{cell.name}.{name}"

    def card(name: str) -> str:
        return f"{name}.x{cell.name}"

    end = card if record.letter == "K" else node
    control = card if record.letter in "FH" else node
    return LinearPart(
        record.letter,
        card(record.name),
        end(record.a),
        end(record.b),
        record.value,
        tuple(map(control, record.control)),
    )
