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

Passive = Resistor | Capacitor
Cell = OpAmpCell | SignalAmplifier
Rung = tuple[str, Resistor | Capacitor | CurrentSource]  # the node at the other end, and the part


@dataclass(frozen=True, slots=True)
class Stage:
    """An amplifier with the parts at its input.

    Attributes
    ----------
    node : str
        The input: a summing node, or what a buffer or an ideal amplifier follows.
    cell : OpAmpCell, SignalAmplifier or None
        None for a node without an amplifier.
    rungs : tuple of Rung
        Parts from signals, or from ground, into the node.
    feedback, shunts : tuple of Resistor and Capacitor
        Parts from the output to the node, and from the node to ground.
    """

    node: str
    cell: Cell | None
    rungs: tuple[Rung, ...]
    feedback: tuple[Passive, ...]
    shunts: tuple[Passive, ...]

    @property
    def output(self) -> str:
        """The node at the output."""
        return self.node if self.cell is None else self.cell.output

    def follows(self, other: Stage) -> bool:
        """Whether the output of another stage is all that drives this one."""
        return [signal for signal, _ in self.rungs] == [other.output] or (
            not self.rungs and self.node == other.output
        )


@dataclass(frozen=True, slots=True)
class DrawnBranch:
    """A channel or a sensor row: chains of stages that follow each other, and all other parts."""

    chains: tuple[tuple[Stage, ...], ...]
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


def branches_of(circuit: Circuit, n: int, k: int) -> list[tuple[str, str]]:
    """Return title and first node of the branches of channel `n` and row `k`, from 1, each once."""
    found: list[tuple[str, str]] = []
    kinds = (
        (Role.FEEDBACK, f"Signal plane, channel {n}", n),
        (Role.FORWARD, f"Constraint plane, sensor row {k}", k),
    )
    for role, title, place in kinds:
        for matrix in circuit.matrices:
            if matrix.name in circuit.named(role) and (node := matrix.sinks[place - 1]):
                if node != GROUND and all(
                    node not in nodes_of_branch(circuit, start) for _, start in found
                ):
                    found.append((title, node))
                break
    return found


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
    chains: list[list[Stage]] = []
    summing = {node for matrix in circuit.matrices for node in matrix.sinks}
    for node in nodes:
        cells: list[Cell | None] = [cell for cell in amplifiers if input_of(cell) == node]
        for cell in cells or [None] * (node == start or node in summing):
            stage = _stage(circuit, node, cell, left)
            before = next((chain for chain in chains if stage.follows(chain[-1])), None)
            if before is None:
                chains.append([stage])
            else:
                before.append(stage)
    pair = tuple(each for each in circuit.transistors if known & set(_ends(each)))
    return DrawnBranch(tuple(map(tuple, chains)), pair, tuple(left.values()))


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
