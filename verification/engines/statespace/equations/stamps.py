"""Stamp the descriptor equations of a `Circuit` (see `descriptor`).

All parts of a kind are stamped at once, as arrays; `opamp_stamps` has the op-amps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.wired_arrays import port_matrices
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.cell_stamps import (
    stamp_imported,
    stamp_opamps,
    stamp_transistors,
)
from taction.verification.engines.statespace.equations.descriptor import (
    GROUND,
    Coupling,
    Descriptor,
    Devices,
    Stamper,
    Triplets,
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

    Raises
    ------
    EngineError
        Two ideal sources drive one node, or an amplifier's input is grounded.
    """
    imported = tuple(cell for cell in circuit.opamps if circuit.linear_model(cell) is not None)
    circuit = replace(circuit, opamps=tuple(c for c in circuit.opamps if c not in imported))
    stamper = Stamper(circuit)
    foreign = stamper.nodes(
        n for cell in imported for n in (cell.noninverting, cell.inverting, cell.output)
    ).reshape(-1, 3)
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
    stamp_imported(stamper, imported, foreign)
    transistors = stamp_transistors(stamper, legs.reshape(-1, 3))
    devices = devices.joined(transistors, *stamp_opamps(stamper, wired))
    ohms = np.array([part.ohms for part in circuit.resistors], dtype=np.float64)
    stamper.currents.branch(resistors[0::2], resistors[1::2], -1.0 / ohms)
    farads = np.array([part.farads for part in circuit.capacitors], dtype=np.float64)
    stamper.mass.branch(capacitors[0::2], capacitors[1::2], farads)
    if circuit.branches:
        from taction.verification.engines.statespace.equations.branch_stamps import stamp_branches

        stamp_branches(stamper)
    return _finish(stamper, node_count, devices)


def _finish(stamper: Stamper, node_count: int, devices: Devices) -> Descriptor:
    switched, constant = stamper.sources(devices)
    board = np.append(np.ones(len(stamper.places), dtype=np.bool_), False)
    determined = np.zeros(len(stamper.places), dtype=np.bool_)
    determined[list(stamper.fixed)] = True
    free = board & np.append(~determined, False)
    laws, currents = stamper.laws.triplets(board), stamper.currents.triplets(free)
    couplings = []
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
        local=Triplets(
            np.concatenate([laws.rows, currents.rows]),
            np.concatenate([laws.columns, currents.columns]),
            np.concatenate([laws.values, currents.values]),
        ),
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
