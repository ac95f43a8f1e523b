"""From a `Circuit` to its descriptor equations (`equations.Descriptor`).

The op-amp is ``A(s) = A0 / ((1 + s/p1)(1 + s/p2))`` with ``p1 = 2 pi gbw / A0``: an integrator
``x1' = -p1 x1 + 2 pi gbw (v+ - v-)``, a lag ``x2' = p2 (x1 - x2)``, and its output a source
behind the output resistance.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from netlist_gen.circuit import Circuit, OpAmpCell, ResistorMatrix
from spice_models.errors import EngineError
from spice_models.opamp import OpAmp
from verification.engines.equations import Coupling, Descriptor, Devices, Floats, Ints, Triplets

GROUND = -1


class _Stamper:
    """Collects stamps; rows of determined nodes take no current."""

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.places: dict[str, int] = {}
        self.determined: set[int] = set()
        self.K: list[tuple[int, int, float]] = []
        self.M: list[tuple[int, int, float]] = []
        self.blocks: list[tuple[Ints, Floats]] = []
        self.couplings: list[tuple[Ints, Ints, Floats]] = []

    def node(self, name: str) -> int:
        if name == "0":
            return GROUND
        return self.places.setdefault(name, len(self.places))

    def fix(self, place: int, what: str) -> int:
        """Claim a node's row for an ideal source."""
        if place == GROUND or place in self.determined:
            message = f"{what} drives a node whose voltage another ideal source determines"
            raise EngineError(message)
        self.determined.add(place)
        return place

    def branch(self, into: list[tuple[int, int, float]], a: int, b: int, value: float) -> None:
        """Stamp a two-terminal element between places a and b."""
        for p, q in ((a, b), (b, a)):
            if p != GROUND and p not in self.determined:
                into.append((p, p, value))
                if q != GROUND:
                    into.append((p, q, -value))

    def conductance(self, a: int, b: int, siemens: float) -> None:
        """Stamp -G into K (K z is the current that flows into a node)."""
        self.branch(self.K, a, b, -siemens)

    def matrix(self, matrix: ResistorMatrix) -> None:
        """Stamp a resistor matrix: arrays off the diagonal, sums on it."""
        G = np.divide(1.0, matrix.ohms)
        G, negative = (G, matrix.negative) if matrix.by_column else (G.T, matrix.negative.T)
        live = np.flatnonzero(G.any(axis=1))  # a row without a resistor may not have its node
        G, negative = G[live], negative[live]
        sinks = np.array([self.node(matrix.sinks[k]) for k in live], dtype=np.int64)
        for names, part in (
            (matrix.plus, np.where(negative, 0.0, G)),
            (matrix.minus, np.where(negative, G, 0.0)),
        ):
            used = np.flatnonzero(part.any(axis=0))
            if not used.size:
                continue
            part = np.ascontiguousarray(part[:, used])
            drivers = np.array([self.node(names[d]) for d in used], dtype=np.int64)
            self.blocks += [(sinks, -part.sum(axis=1)), (drivers, -part.sum(axis=0))]
            driven = drivers != GROUND
            self.couplings.append((sinks, drivers[driven], part[:, driven]))

    def opamp(self, cell: OpAmpCell, model: OpAmp) -> None:
        """Stamp one op-amp macromodel."""
        plus, minus, out = map(self.node, (cell.noninverting, cell.inverting, cell.output))
        self.conductance(plus, minus, 1.0 / model.input_resistance)
        self.branch(self.M, plus, minus, model.differential_capacitance)
        for pin in (plus, minus):
            self.branch(self.M, pin, GROUND, model.input_capacitance)
        # `stage` is the signal so far, as a list of (place, factor).
        stage = [(p, f) for p, f in ((plus, 1.0), (minus, -1.0)) if p != GROUND]
        if math.isfinite(model.gbw):
            rate = 2.0 * math.pi * model.gbw
            stage = self.lag(f"x{cell.name}.p1", rate / model.dc_gain, rate, stage)
        else:
            stage = [(p, model.dc_gain * f) for p, f in stage]
        if math.isfinite(model.second_pole):
            rate = 2.0 * math.pi * model.second_pole
            stage = self.lag(f"x{cell.name}.p2", rate, rate, stage)
        if out in self.determined:
            self.K += [(out, p, f) for p, f in stage] + [(out, out, -1.0)]
        elif out != GROUND:
            g = 1.0 / model.output_resistance
            self.K += [(out, p, f * g) for p, f in stage] + [(out, out, -g)]

    def lag(
        self, name: str, rate: float, gain: float, stage: list[tuple[int, float]]
    ) -> list[tuple[int, float]]:
        """Add the state ``x' = -rate x + gain stage``; return it as the new stage."""
        x = self.node(name)
        self.M.append((x, x, 1.0))
        self.K += [(x, p, gain * f) for p, f in stage] + [(x, x, -rate)]
        return [(x, 1.0)]


def _nodes_first(stamper: _Stamper) -> int:
    """Give every node its place before the op-amp states; return their number."""
    c = stamper.circuit
    for name in (
        *(n for cell in c.opamps for n in (cell.noninverting, cell.inverting, cell.output)),
        *(n for a in c.amplifiers for n in (a.input, a.output)),
        *(n for r in c.resistors for n in (r.a, r.b)),
        *(n for x in c.capacitors for n in (x.a, x.b)),
        *(i.node for i in c.currents),
        *(v.node for v in c.voltages),
    ):
        stamper.node(name)
    return len(stamper.places)


def _claim_rows(stamper: _Stamper) -> None:
    c = stamper.circuit
    for source in c.voltages:
        stamper.fix(stamper.node(source.node), source.name)
    for amplifier in c.amplifiers:
        stamper.fix(stamper.node(amplifier.output), amplifier.name)
    for cell in c.opamps:
        if c.models[cell.model].output_resistance == 0.0:
            stamper.fix(stamper.node(cell.output), cell.name)


def _devices(stamper: _Stamper) -> Devices:
    amplifiers = stamper.circuit.amplifiers
    kinds = {a.kind for a in amplifiers}
    if len(kinds) > 1:
        message = f"the signal amplifiers are of several kinds: {', '.join(sorted(kinds))}"
        raise EngineError(message)
    if any(a.input == "0" for a in amplifiers):
        raise EngineError("a signal amplifier's input is grounded")
    return Devices(
        kind=next(iter(kinds), ""),
        input=np.array([stamper.node(a.input) for a in amplifiers], dtype=np.int64),
        output=np.array([stamper.node(a.output) for a in amplifiers], dtype=np.int64),
        u_scale=np.array([a.u_scale for a in amplifiers], dtype=np.float64),
        v_scale=np.array([a.v_scale for a in amplifiers], dtype=np.float64),
    )


def _triplets(entries: list[tuple[int, int, float]]) -> Triplets:
    rows, columns, values = zip(*entries, strict=True) if entries else ((), (), ())
    return Triplets(
        np.array(rows, dtype=np.int64),
        np.array(columns, dtype=np.int64),
        np.array(values, dtype=np.float64),
    )


@functools.lru_cache(maxsize=1)  # one verification asks several times for the same board
def stamp(circuit: Circuit) -> Descriptor:
    """Stamp a board.

    Returns
    -------
    Descriptor
        SI base units throughout.

    Raises
    ------
    EngineError
        Two ideal sources on one node, or amplifiers of several kinds.
    """
    stamper = _Stamper(circuit)
    node_count = _nodes_first(stamper)
    _claim_rows(stamper)
    for matrix in circuit.matrices:
        stamper.matrix(matrix)
    for cell in circuit.opamps:
        stamper.opamp(cell, circuit.models[cell.model])
    for resistor in circuit.resistors:
        a, b = stamper.node(resistor.a), stamper.node(resistor.b)
        stamper.conductance(a, b, 1.0 / resistor.ohms)
    for capacitor in circuit.capacitors:
        a, b = stamper.node(capacitor.a), stamper.node(capacitor.b)
        stamper.branch(stamper.M, a, b, capacitor.farads)
    return _finish(stamper, node_count)


def _finish(stamper: _Stamper, node_count: int) -> Descriptor:
    c, size = stamper.circuit, len(stamper.places)
    devices = _devices(stamper)
    determined = np.zeros(size, dtype=np.bool_)
    determined[list(stamper.determined)] = True
    switched, constant = np.zeros(size), np.zeros(size)
    for current in c.currents:
        place = stamper.node(current.node)
        if place != GROUND and not determined[place]:
            switched[place] += current.amps
    for voltage in c.voltages:
        place = stamper.node(voltage.node)
        constant[place] = voltage.volts
        stamper.K.append((place, place, -1.0))
    stamper.K += [(int(p), int(p), -1.0) for p in devices.output]
    local = _triplets([entry for entry in stamper.K if entry[2] != 0.0])
    for places, values in stamper.blocks:
        kept = (places != GROUND) & ~determined[places]
        at = places[kept]
        local = Triplets(
            np.concatenate([local.rows, at]),
            np.concatenate([local.columns, at]),
            np.concatenate([local.values, values[kept]]),
        )
    couplings = []
    for sinks, drivers, G in stamper.couplings:
        live = sinks != GROUND
        if determined[sinks[live]].any():
            raise EngineError("an ideal source drives a summing node of a resistor matrix")
        couplings.append(Coupling(sinks[live], drivers, G[live], ~determined[drivers]))
    mass = _triplets([entry for entry in stamper.M if entry[2] != 0.0])
    return Descriptor(
        names=tuple(stamper.places),
        node_count=node_count,
        mass=mass,
        local=local,
        couplings=tuple(couplings),
        switched=switched,
        constant=constant,
        determined=determined,
        devices=devices,
        places=stamper.places,
    )
