"""The stages of a board, found from its nodes alone: amplifiers with the parts around them.

A branch is a part of the board that is connected without the matrices, ground and the constant
voltages: a channel, or a sensor row. So every topology can be drawn, also one of another package.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit, Role
from taction.netlist_gen.board.parts import (
    Capacitor,
    CurrentSource,
    OpAmpCell,
    Resistor,
    SignalAmplifier,
    TransistorCell,
)

KINDS = {Role.FEEDBACK: ("channel", "Signal plane, channel"),
         Role.FORWARD: ("row", "Constraint plane, sensor row")}  # fmt: skip
Passive = Resistor | Capacitor
Cell = OpAmpCell | SignalAmplifier
Rung = tuple[str, Resistor | Capacitor | CurrentSource]  # the node at the other end, and the part


@dataclass(frozen=True, slots=True)
class Stage:
    """An amplifier with the parts at its input."""

    node: str  # the input: a summing node, or what a buffer or an ideal amplifier follows
    cell: Cell | None  # None for a node without an amplifier
    rungs: tuple[Rung, ...]  # parts from signals, or from ground, into the node
    feedback: tuple[Passive, ...]  # from the output to the node
    shunts: tuple[Passive, ...]  # from the node to ground

    @property
    def output(self) -> str:
        """The node at the output."""
        return self.node if self.cell is None else self.cell.output


@dataclass(frozen=True, slots=True)
class DrawnBranch:
    """A channel or a sensor row: stages in the order of the signal, and all other parts."""

    stages: tuple[Stage, ...]
    transistors: tuple[TransistorCell, ...]
    loose: tuple[Passive, ...]


def shared_nodes(circuit: Circuit) -> set[str]:
    """Return the nodes that several branches use: outputs, drivers of matrices, voltages."""
    found = {source.node for source in circuit.voltages}
    found |= {output.node for output in circuit.outputs}
    return found.union(*({*matrix.plus, *matrix.minus} for matrix in circuit.matrices))


def driven_row(circuit: Circuit, n: int) -> int:
    """Return the sensor row that channel `n` drives most; 0 without a matrix resistor."""
    ohms = circuit.forward_ohms[:, n - 1]
    return 1 + int(np.argmin(ohms)) if np.isfinite(ohms).any() else 0


def branches(circuit: Circuit) -> Iterator[tuple[str, str, str]]:
    """Yield each branch of a board once: the name of its sheet, its first node, and its title."""
    shared = shared_nodes(circuit)
    known: set[str] = set()
    for role, (word, title) in KINDS.items():
        matrices = [each for each in circuit.matrices if each.name in circuit.named(role)]
        sinks = (pair for each in matrices for pair in enumerate(each.sinks, 1))
        for number, start in sinks:
            if start and start != GROUND and start not in known:
                known |= set(nodes_of_branch(circuit, start))
                yield f"{word}-{number}", start, f"{title} {number}"
    inputs = [input_of(cell) for cell in circuit.opamps]
    left = [node for node in inputs if node not in known | shared]
    for number, start in enumerate(left, 1):
        if start not in known:
            known |= set(nodes_of_branch(circuit, start))
            yield f"more-{number}", start, f"More stages, {number}"


def middle_channel(circuit: Circuit) -> int:
    """Return the middle channel, or the first one that has a matrix resistor."""
    middle = 1 + (circuit.shape[1] - 1) // 2
    return middle if driven_row(circuit, middle) else next(
        n for n in range(1, 1 + circuit.shape[1]) if driven_row(circuit, n)
    )  # fmt: skip


def branch(circuit: Circuit, start: str) -> DrawnBranch:
    """Return the branch of a node, with the matrix resistors that end at it."""
    nodes = nodes_of_branch(circuit, start)
    known = set(nodes)
    parts: tuple[Passive, ...] = (*circuit.resistors, *circuit.real_capacitors)
    left = {part.card: part for part in parts if known & {part.a, part.b}}
    amplifiers: tuple[Cell, ...] = (*circuit.opamps, *circuit.amplifiers)
    stages: list[Stage] = []
    summing = {node for matrix in circuit.matrices for node in matrix.sinks}
    for node in nodes:
        cells: list[Cell | None] = [cell for cell in amplifiers if input_of(cell) == node]
        for cell in cells or [None] * (node == start or node in summing):
            stages.append(_stage(circuit, node, cell, left))
    pair = tuple(each for each in circuit.transistors if known & set(_ends(each)))
    return DrawnBranch(tuple(stages), pair, tuple(left.values()))


def _stage(circuit: Circuit, node: str, cell: Cell | None, left: dict[str, Passive]) -> Stage:
    """Return the stage of an amplifier, its parts taken out of those that are left."""
    rungs: list[Rung] = [(part.a, part) for part in _into(circuit, node)]
    feedback, shunts = [], []
    for part in [each for each in left.values() if node in (each.a, each.b)]:
        del left[part.card]
        other = part.b if part.a == node else part.a
        if isinstance(cell, OpAmpCell) and (cell.inverting, cell.output) == (node, other):
            feedback.append(part)
        elif other == GROUND:
            shunts.append(part)
        else:
            rungs.append((other, part))
    rungs += [(GROUND, current) for current in circuit.currents if current.node == node]
    return Stage(node, cell, tuple(rungs), tuple(feedback), tuple(shunts))


def _into(circuit: Circuit, node: str) -> Iterator[Resistor]:
    """Yield the matrix resistors that end at a node; `a` is their driver."""
    for matrix in circuit.matrices:
        if node in matrix.sinks:
            place = matrix.sinks.index(node)
            chosen = (place, slice(None)) if matrix.by_column else (slice(None), place)
            ohms = np.full_like(matrix.ohms, np.inf)
            ohms[chosen] = matrix.ohms[chosen]
            yield from replace(matrix, ohms=ohms).resistors()


def nodes_of_branch(circuit: Circuit, start: str) -> list[str]:
    """Return the nodes of a branch, in the order in which a signal from `start` reaches them."""
    fixed = {GROUND, *(source.node for source in circuit.voltages)}
    parts: tuple[Passive | Cell | TransistorCell, ...] = (
        *circuit.opamps,
        *circuit.amplifiers,
        *circuit.resistors,
        *circuit.real_capacitors,
        *circuit.transistors,
    )
    joined: dict[str, list[str]] = {}
    for part in parts:
        for end in (ends := _ends(part)):
            joined.setdefault(end, []).extend(ends)
    found = [start]
    for node in found:
        new = (end for end in joined.get(node, ()) if end not in fixed and end not in found)
        found += dict.fromkeys(new)
    return found


def _ends(part: Passive | Cell | TransistorCell) -> tuple[str, ...]:
    if isinstance(part, OpAmpCell):
        return part.noninverting, part.inverting, part.output
    if isinstance(part, SignalAmplifier):
        return part.input, part.output
    if isinstance(part, TransistorCell):
        return part.collector, part.base, part.emitter
    return part.a, part.b


def input_of(cell: Cell) -> str:
    """Return the node at which the stage of an amplifier begins."""
    if isinstance(cell, SignalAmplifier):
        return cell.input
    other = cell.inverting in (cell.output, GROUND)
    return cell.noninverting if other else cell.inverting
