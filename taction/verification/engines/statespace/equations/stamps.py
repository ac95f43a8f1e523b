"""Stamp the descriptor equations of a `Circuit` (see `descriptor`).

All parts of a kind are stamped at once, as arrays; `cell_stamps` has the op-amps.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.linear_models import with_linear_models
from taction.netlist_gen.board.parts import ResistorMatrix
from taction.netlist_gen.board.wired_arrays import port_matrices
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

    Raises
    ------
    EngineError
        Two ideal sources drive one node, or an amplifier's input is grounded.
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
        from taction.verification.engines.statespace.equations.branch_stamps import stamp_branches

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
