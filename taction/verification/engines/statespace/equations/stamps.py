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

import operator
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.linear_models import with_linear_models
from taction.netlist_gen.board.parts import ResistorMatrix
from taction.netlist_gen.board.wired_arrays import port_matrices
from taction.spice_models.branches import Branch, Source
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.alike import in_groups
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
        u_scale=stamper.values(lambda circuit: [a.u_scale for a in circuit.amplifiers]),
        v_scale=stamper.values(lambda circuit: [a.v_scale for a in circuit.amplifiers]),
    )


def stamp(circuit: Circuit) -> Descriptor:
    """Return the descriptor equations of a board, in SI base units.

    EngineError: two ideal sources drive one node, or an amplifier's input is grounded.
    """
    (found,) = stamp_together([circuit])
    if isinstance(found, EngineError):
        raise found
    return found


def stamp_together(circuits: Sequence[Circuit]) -> list[Descriptor | EngineError]:
    """Return the equations of boards, or why a board has none; see `stamp`.

    Boards that differ in values alone are stamped together.

    Examples
    --------
    >>> import taction
    >>> from taction.netlist_gen.board.synthesis import synthesise
    >>> circuit = synthesise(taction.load_scene("scenes/custom-matrix.toml"))
    >>> one, other = stamp_together([circuit, circuit])
    >>> one.names is other.names
    True
    """
    return in_groups(circuits, _differ_in_values, _stamp)


def _differ_in_values(one: Circuit, other: Circuit) -> bool:
    """Whether two circuits have the same parts between the same nodes, of kinds with arrays."""
    return (
        one.opamps == other.opamps
        and one.supply == other.supply
        and list(one.models) == list(other.models)
        and not any(c.transistors or c.has_imported for c in (one, other))
        and len(one.branches) == len(other.branches)
        and list(map(_WIRED, one.branches)) == list(map(_WIRED, other.branches))
        and list(map(_ENDS, one.resistors)) == list(map(_ENDS, other.resistors))
        and list(map(_ENDS, one.capacitors)) == list(map(_ENDS, other.capacitors))
        and list(map(_AMPLIFIED, one.amplifiers)) == list(map(_AMPLIFIED, other.amplifiers))
        and [source.node for source in one.currents] == [source.node for source in other.currents]
        and list(map(_VOLTAGE, one.voltages)) == list(map(_VOLTAGE, other.voltages))
        and len(one.matrices) == len(other.matrices)
        and all(map(_alike, one.matrices, other.matrices))
    )


_ENDS = operator.attrgetter("a", "b")
_WIRED = operator.attrgetter("card", "a", "b", "control")
_AMPLIFIED = operator.attrgetter("kind", "input", "output")
_VOLTAGE = operator.attrgetter("node", "switched")
_LINES = operator.attrgetter("by_column", "plus", "minus", "sinks", "wires")


def _alike(one: ResistorMatrix, other: ResistorMatrix) -> bool:
    """Whether two matrices without wires have the same nodes and signs."""
    same = one.wires is None and _LINES(one) == _LINES(other)
    return same and np.array_equal(one.negative, other.negative)


def _stamp(circuits: Sequence[Circuit]) -> list[Descriptor]:
    """Return the equations of circuits that differ in values alone."""
    if circuits[0].has_imported:
        circuits = [with_linear_models(circuit) for circuit in circuits]
    circuit, stamper = circuits[0], Stamper(circuits)
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
    for matrices in zip(*map(port_matrices, circuits), strict=True):
        stamper.matrix(matrices)
    node_count = len(stamper.places)
    transistors = stamp_transistors(stamper, legs.reshape(-1, 3))
    devices = devices.joined(transistors, *stamp_opamps(stamper, wired))
    ohms = stamper.values(lambda c: [part.ohms for part in c.resistors])
    stamper.currents.branch(resistors[0::2], resistors[1::2], -1.0 / ohms)
    farads = stamper.values(lambda c: [part.farads for part in c.capacitors])
    stamper.mass.branch(capacitors[0::2], capacitors[1::2], farads)
    if circuit.branches:
        stamp_branches(stamper)
    return _finish(stamper, node_count, devices)


def _finish(stamper: Stamper, node_count: int, devices: Devices) -> list[Descriptor]:
    switched, constant = stamper.sources(devices)
    board, boards = np.append(np.ones(len(stamper.places), dtype=np.bool_), False), len(switched)
    determined = np.zeros(len(stamper.places), dtype=np.bool_)
    determined[list(stamper.fixed)] = True
    free = board & np.append(~determined, False)
    laws, currents = stamper.laws.triplets(board, boards), stamper.currents.triplets(free, boards)
    mass, couplings = stamper.mass.triplets(free, boards), list[Sequence[Coupling]]()
    for sinks, drivers, stack, among in stamper.couplings:
        live = sinks != GROUND
        if determined[sinks[live]].any():
            raise EngineError("an ideal source drives a summing node of a resistor matrix")
        loaded = np.zeros_like(determined[drivers]) if among else ~determined[drivers]
        couplings.append([Coupling(sinks[live], drivers, G[live], loaded) for G in stack])
    names = tuple(stamper.places)
    return [
        Descriptor(
            names=names,
            node_count=node_count,
            mass=mass[k],
            local=laws[k].joined(currents[k]),
            couplings=tuple(each[k] for each in couplings),
            switched=switched[k],
            constant=constant[k],
            determined=determined,
            devices=replace(devices, u_scale=devices.u_scale[k], v_scale=devices.v_scale[k]),
            places=stamper.places,
            mirror=proposed_mirror(names),
            has_branches=bool(stamper.circuit.branches),
            moved=stamper.moved,
        )
        for k in range(boards)
    ]


def current_of(card: str) -> str:
    """Return the name of the unknown that is the current of a card, from its node `a` to `b`."""
    return f"i({card})"


def stamp_branches(stamper: Stamper) -> None:
    """Stamp every branch of the circuits; call it after all other parts.

    EngineError: sources of voltage that form a loop, or a card that controls another one and is not
      there.
    """
    _Branches(stamper, stamper.circuit.branches).stamp()


class _Branches:
    """Stamps of all branches; `rows` is the row that takes the current into each place.

    `values` has those of a card in each circuit, (B,).
    """

    def __init__(self, stamper: Stamper, parts: tuple[Branch, ...]) -> None:
        self.stamper, self.parts = stamper, parts
        self.cards = {part.card: k for k, part in enumerate(parts)}
        self.values = stamper.values(lambda c: [part.value for part in c.branches])
        self.sensed = {part.control[0]: part.card for part in parts if part.letter in "FH"}
        for card, by in self.sensed.items():
            if card not in self.cards:
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
            row, (before, step) = np.array([child]), self._steps(part)
            stamper.constant_laws.append((row, sign * before))
            stamper.switched.append((row, sign * step))
        elif part.letter == "E":
            for place, gain in self._controls(part):
                self._state(child, place, sign * gain)
        else:
            self._state(child, self._current(part.control[0]), sign * self._value(part.card))

    def _value(self, card: str) -> Floats:
        return self.values[:, self.cards[card]]

    def _steps(self, part: Branch) -> tuple[Floats, Floats]:
        """Return what a source has before t = 0, and what is switched on then, (B, 1) each."""
        k = self.cards[part.card]
        parts = [c.branches[k] for c in self.stamper.circuits]
        found = [(p.before, p.step) if isinstance(p, Source) else (p.value, 0.0) for p in parts]
        before, step = np.array(found).T[:, :, None]
        return before, step

    def _controls(self, part: Branch) -> Iterator[tuple[int, Floats]]:
        value = self._value(part.card)
        for node, gain in zip(part.control, (value, -value), strict=True):
            yield self._place(node), gain

    def _state(self, row: int, column: int, value: float | Floats) -> None:
        self.stamper.laws.add_one(row, column, value)

    def _add(self, row: int, column: int, value: float | Floats, back: int) -> None:
        """Add a current out of the node `back` into `row`, or to the balance of a current."""
        self.stamper.currents.add_one(row, column, value, back)

    def _through(self, part: Branch, column: int, value: float | Floats) -> None:
        """Add a current from `part.a` through the part to `part.b`."""
        a, b = self._ends(part)
        self._add(a, column, -value, b)
        self._add(b, column, value, a)

    def _flow(self, part: Branch) -> None:
        """Stamp what flows through a part that is no source of voltage."""
        mass, value = self.stamper.mass, self._value(part.card)
        match part.letter:
            case "L":
                current, (a, b) = self._current(part.card), self._ends(part)
                mass.add_one(current, current, value)
                self._state(current, a, 1.0)
                self._state(current, b, -1.0)
                self._through(part, current, 1.0)
            case "K":
                henries = value * np.sqrt(self._value(part.a) * self._value(part.b))
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
        (a, b), (before, step) = self._ends(part), self._steps(part)
        for place, sign in ((a, -1.0), (b, 1.0)):
            row, taken = np.array([place]), np.array([rows[place]])
            self.stamper.constant_currents.append((row, sign * before))
            self.stamper.switched.append((taken, sign * step))

    def _move(self) -> None:
        stamper = self.stamper
        stamper.moved = {k: row for k, row in enumerate(self.rows) if row != k}
        rows = np.array([*self.rows, GROUND], dtype=np.int64)
        for entries in (stamper.currents, stamper.mass):
            row, column, values = entries.joined(len(stamper.circuits))
            row, back = rows[row], rows[entries.backs]
            # A part between two nodes that have one row adds exactly nothing to it.
            live = np.flatnonzero((row != GROUND) & (column != GROUND) & (row != back))
            entries.replace(row[live], column[live], values.take(live, axis=1))
        stamper.constant_currents[:] = [
            (rows[i], values) for i, values in stamper.constant_currents
        ]
