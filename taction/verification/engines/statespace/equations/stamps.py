"""Stamp the descriptor equations of a `Circuit` (see `descriptor`).

All parts of a kind are stamped at once, as arrays; `cell_stamps` has the op-amps.

Coils and sources between any two nodes are those of modified nodal analysis without needless
unknowns. A source of voltage (V, E, H) determines the voltage of one of its nodes, whose row states
its law, and its current balance is added to that of the other node: both are one node to all
currents. So its own current is no unknown, and a capacitor at an ideal source raises no index. Only
a current that controls another source is an unknown, ``i(card)``; its row is the balance of the
node that its source determines. A coil has its current as state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.linear_models import with_linear_models
from taction.netlist_gen.board.wired_arrays import port_matrices
from taction.spice_models.branches import Branch, Source
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.cell_stamps import (
    stamp_opamps,
    stamp_transistors,
)
from taction.verification.engines.statespace.equations.descriptor import (
    GROUND,
    Coupling,
    Descriptor,
    Devices,
    Stamper,
)
from taction.verification.engines.statespace.equations.mirror_symmetry import proposed_mirror


def _claim_rows(stamper: Stamper) -> None:
    c = stamper.circuit
    for source in c.voltages:
        stamper.fix(source.node, source.name)
    for amplifier in c.amplifiers:
        stamper.fix(amplifier.output, amplifier.name)
    ideal = {name for name, model in c.models.items() if model.output_resistance == 0.0}
    for cell in c.opamps:
        if cell.model in ideal:
            stamper.fix(cell.output, cell.name)


def _devices(stamper: Stamper) -> Devices:
    amplifiers = stamper.circuit.amplifiers
    if any(a.input == "0" for a in amplifiers):
        raise EngineError("a signal amplifier's input is grounded")
    places = stamper.nodes(n for a in amplifiers for n in (a.input, a.output)).reshape(-1, 2)
    return Devices(
        kinds=tuple(a.kind for a in amplifiers),
        input=places[:, 0],
        output=places[:, 1],
        u_scale=np.array([a.u_scale for a in amplifiers], dtype=np.float64),
        v_scale=np.array([a.v_scale for a in amplifiers], dtype=np.float64),
    )


def stamp(circuit: Circuit) -> Descriptor:
    """Return the descriptor equations of a board, in SI base units.

    EngineError: two ideal sources drive one node, or an amplifier's input is grounded.
    """
    if circuit.has_imported:
        circuit = with_linear_models(circuit)
    stamper = Stamper(circuit)
    pins = (n for cell in circuit.opamps for n in (cell.noninverting, cell.inverting, cell.output))
    wired = stamper.nodes(pins).reshape(-1, 3)
    devices = _devices(stamper)
    legs = stamper.nodes(n for q in circuit.transistors for n in (q.collector, q.base, q.emitter))
    resistors = stamper.nodes(n for part in circuit.resistors for n in (part.a, part.b))
    capacitors = stamper.nodes(n for part in circuit.capacitors for n in (part.a, part.b))
    stamper.nodes(source.node for source in circuit.currents)
    stamper.nodes(source.node for source in circuit.voltages)
    stamper.nodes(node for part in circuit.branches for node in part.nodes)
    _claim_rows(stamper)
    for matrix in port_matrices(circuit):
        stamper.matrix(matrix)
    node_count = len(stamper.places)
    transistors = stamp_transistors(stamper, legs.reshape(-1, 3))
    devices = devices.joined(transistors, *stamp_opamps(stamper, wired))
    ohms = np.array([part.ohms for part in circuit.resistors], dtype=np.float64)
    stamper.currents.branch(resistors[0::2], resistors[1::2], -1.0 / ohms)
    farads = np.array([part.farads for part in circuit.capacitors], dtype=np.float64)
    stamper.mass.branch(capacitors[0::2], capacitors[1::2], farads)
    if circuit.branches:
        stamp_branches(stamper)
    return _finish(stamper, node_count, devices)


def _finish(stamper: Stamper, node_count: int, devices: Devices) -> Descriptor:
    switched, constant = stamper.sources(devices)
    board = np.append(np.ones(len(stamper.places), dtype=np.bool_), False)
    determined = np.zeros(len(stamper.places), dtype=np.bool_)
    determined[list(stamper.fixed)] = True
    free, couplings = board & np.append(~determined, False), list[Coupling]()
    for sinks, drivers, G, among in stamper.couplings:
        live = sinks != GROUND
        if determined[sinks[live]].any():
            raise EngineError("an ideal source drives a summing node of a resistor matrix")
        loaded = np.zeros_like(determined[drivers]) if among else ~determined[drivers]
        couplings.append(Coupling(sinks[live], drivers, G[live], loaded))
    names = tuple(stamper.places)
    return Descriptor(
        names=names,
        node_count=node_count,
        mass=stamper.mass.triplets(free),
        local=stamper.laws.triplets(board).joined(stamper.currents.triplets(free)),
        couplings=tuple(couplings),
        switched=switched,
        constant=constant,
        determined=determined,
        devices=devices,
        places=stamper.places,
        mirror=proposed_mirror(names),
        has_branches=bool(stamper.circuit.branches),
        moved=stamper.moved,
    )


def current_of(card: str) -> str:
    """Return the name of the unknown that is the current of a card, from its node `a` to `b`."""
    return f"i({card})"


def stamp_branches(stamper: Stamper) -> None:
    """Stamp every branch of the circuit; call it after all other parts.

    EngineError: sources of voltage that form a loop, or a card that controls another one and is not
      there.
    """
    _Branches(stamper, stamper.circuit.branches).stamp()


class _Branches:
    """Stamps of all branches; `rows` is the row that takes the current into each place."""

    def __init__(self, stamper: Stamper, parts: tuple[Branch, ...]) -> None:
        self.stamper, self.parts = stamper, parts
        self.values = {part.card: part.value for part in parts}
        self.sensed = {part.control[0]: part.card for part in parts if part.letter in "FH"}
        for card, by in self.sensed.items():
            if card not in self.values:
                raise EngineError(f"{by} is controlled by {card}, which is no source")
        coils = [part.card for part in parts if part.letter == "L"]
        names = [current_of(card) for card in dict.fromkeys([*self.sensed, *coils])]
        places: list[int] = stamper.nodes(names).tolist()
        self.currents = dict(zip(names, places, strict=True))
        self.rows = list(range(len(stamper.places)))

    def stamp(self) -> None:
        """Stamp everything, then move what flows into determined nodes to their rows."""
        for part, child, other in self._forest():
            self._law(part, child, other)
        for part in self.parts:
            self._flow(part)
        self._move()

    def _place(self, node: str) -> int:
        return GROUND if node == "0" else self.stamper.places[node]

    def _ends(self, part: Branch) -> tuple[int, int]:
        return self._place(part.a), self._place(part.b)

    def _current(self, card: str) -> int:
        return self.currents[current_of(card)]

    def _forest(self) -> Iterator[tuple[Branch, int, int]]:
        """Yield each source of voltage with the node that it determines, and its other node.

        The sources are the edges of trees that begin at ground and at nodes that are determined
        already; the law of a source belongs to the node that is farther from there.
        """
        at: dict[int, list[Branch]] = {}
        for part in self.parts:
            if part.letter in "VEH":
                for end in self._ends(part):
                    at.setdefault(end, []).append(part)
        reached, used = set[int](), set[str]()
        roots = [GROUND, *sorted(self.stamper.fixed), *at]
        fixed = set(self.stamper.fixed)
        for root in roots:
            if root in reached:
                continue
            reached.add(root)
            ahead = [root]
            while ahead:
                here = ahead.pop(0)
                for part in at.get(here, ()):
                    if part.card in used:
                        continue
                    used.add(part.card)
                    a, b = self._ends(part)
                    child = b if a == here else a
                    if child in reached or child in fixed or child == GROUND:
                        raise EngineError(
                            f"{part.card} closes a loop of ideal voltage sources; put a resistor"
                            " into the loop"
                        )
                    reached.add(child)
                    ahead.append(child)
                    self._join(part, child, here)
                    yield part, child, here

    def _join(self, part: Branch, child: int, other: int) -> None:
        """Add the current balance of a determined node to that of the other one."""
        if part.card in self.sensed:
            current = self.rows[child] = self._current(part.card)
            out = -1.0 if child == self._ends(part)[0] else 1.0  # of the node `child`
            self._add(current, current, out, other)
            self._add(other, current, -out, current)
        else:
            self.rows[child] = GROUND if other == GROUND else self.rows[other]
            if other in self.stamper.fixed and self.rows[other] == other:
                self.rows[child] = GROUND  # an ideal source takes up the current

    def _law(self, part: Branch, child: int, other: int) -> None:
        """State the voltage of a node in its row: ``0 = -v + v_other + drive``."""
        stamper, sign = self.stamper, 1.0 if child == self._ends(part)[0] else -1.0
        stamper.fixed.add(child)
        self._state(child, child, -1.0)
        self._state(child, other, 1.0)
        if part.letter == "V":
            row, (before, step) = np.array([child]), _steps(part)
            stamper.constant_laws.append((row, sign * before))
            stamper.switched.append((row, sign * step))
        elif part.letter == "E":
            for place, gain in self._controls(part):
                self._state(child, place, sign * gain)
        else:
            self._state(child, self._current(part.control[0]), sign * self.values[part.card])

    def _controls(self, part: Branch) -> Iterator[tuple[int, float]]:
        for node, gain in zip(part.control, (part.value, -part.value), strict=True):
            yield self._place(node), gain

    def _state(self, row: int, column: int, value: float) -> None:
        self.stamper.laws.add_one(row, column, value)

    def _add(self, row: int, column: int, value: float, back: int) -> None:
        """Add a current out of the node `back` into `row`, or to the balance of a current."""
        self.stamper.currents.add_one(row, column, value, back)

    def _through(self, part: Branch, column: int, value: float) -> None:
        """Add a current from `part.a` through the part to `part.b`."""
        a, b = self._ends(part)
        self._add(a, column, -value, b)
        self._add(b, column, value, a)

    def _flow(self, part: Branch) -> None:
        """Stamp what flows through a part that is no source of voltage."""
        mass, value = self.stamper.mass, part.value
        match part.letter:
            case "L":
                current, (a, b) = self._current(part.card), self._ends(part)
                mass.add_one(current, current, value)
                self._state(current, a, 1.0)
                self._state(current, b, -1.0)
                self._through(part, current, 1.0)
            case "K":
                henries = value * math.sqrt(self.values[part.a] * self.values[part.b])
                one, other = (self._current(card) for card in (part.a, part.b))
                mass.add_one(one, other, henries)
                mass.add_one(other, one, henries)
            case "I":
                self._source(part)
            case "G":
                for place, gain in self._controls(part):
                    self._through(part, place, gain)
            case "Y":  # what flows out of `part.a` is on the left of ``M z' = K z``
                a, b = self._ends(part)
                for place, gain in self._controls(part):
                    mass.add_one(a, place, gain, b)
                    mass.add_one(b, place, -gain, a)
            case "F":
                self._through(part, self._current(part.control[0]), value)

    def _source(self, part: Branch) -> None:
        rows = [*self.rows, GROUND]  # which take the currents into places; ground stays ground
        (a, b), (before, step) = self._ends(part), _steps(part)
        for place, sign in ((a, -1.0), (b, 1.0)):
            row, taken = np.array([place]), np.array([rows[place]])
            self.stamper.constant_currents.append((row, sign * before))
            self.stamper.switched.append((taken, sign * step))

    def _move(self) -> None:
        stamper = self.stamper
        stamper.moved = {k: row for k, row in enumerate(self.rows) if row != k}
        rows = np.array([*self.rows, GROUND], dtype=np.int64)
        stamper.currents.move(rows)
        stamper.mass.move(rows)
        stamper.constant_currents[:] = [
            (rows[i], values) for i, values in stamper.constant_currents
        ]


def _steps(part: Branch) -> tuple[Floats, Floats]:
    """Return what a source has before t = 0, and what is switched on then, (1,) each."""
    found = (part.before, part.step) if isinstance(part, Source) else (part.value, 0.0)
    return np.array([found[0]]), np.array([found[1]])
