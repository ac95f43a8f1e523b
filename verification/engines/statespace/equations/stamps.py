"""Stamp the descriptor equations of a `Circuit` (see `descriptor`).

The op-amp is ``A(s) = A0 / ((1 + s/p1)(1 + s/p2))`` with ``p1 = 2 pi gbw / A0``: an integrator
``x1' = -p1 x1 + 2 pi gbw (v+ - v-)``, a lag ``x2' = p2 (x1 - x2)``, and a voltage source behind the
output resistance. All parts of a kind are stamped at once, as arrays.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from netlist_gen.board.circuit import Circuit, ResistorMatrix
from spice_models.array_types import Bools, Floats, Ints
from spice_models.errors import EngineError
from spice_models.opamp import KNEE
from verification.engines.statespace.equations.descriptor import (
    Coupling,
    Descriptor,
    Devices,
    Triplets,
)
from verification.engines.statespace.equations.imported_stamps import stamp_imported
from verification.engines.statespace.equations.mirror_symmetry import proposed_mirror
from verification.engines.statespace.equations.transistor_stamps import stamp_transistors

GROUND = -1
INPUT_STAGE, CLAMP = "tanh", "clamp"  # kinds of the devices of op-amps with limits
FIGURES = operator.attrgetter(
    "dc_gain",
    "gbw",
    "second_pole",
    "input_resistance",
    "differential_capacitance",
    "input_capacitance",
    "output_resistance",
)


class _Entries:
    """A growing matrix: arrays of (row, column, value), ground included."""

    def __init__(self) -> None:
        self.parts: list[tuple[Ints, Ints, Floats]] = []

    def add(self, rows: Ints, columns: Ints, values: Floats) -> None:
        """Stamp one entry in each row."""
        self.parts.append((rows, columns, values))

    def branch(self, a: Ints, b: Ints, values: Floats) -> None:
        """Stamp two-terminal elements between places a and b."""
        for p, q in ((a, b), (b, a)):
            self.add(p, p, values)
            self.add(p, q, -values)

    def triplets(self, rows: Bools) -> Triplets:
        """Return the entries of the chosen `rows` (size + 1, the last for ground)."""
        i, j, values = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        live = np.flatnonzero(rows[i] & (j != GROUND) & (values != 0.0))
        return Triplets(i[live], j[live], values[live])


class _Stamper:
    """Collector of stamps: currents, which do not apply to rows of ideal sources, and laws."""

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.places: dict[str, int] = {}
        self.fixed: set[int] = set()
        self.currents, self.laws, self.mass = _Entries(), _Entries(), _Entries()
        self.couplings: list[tuple[Ints, Ints, Floats]] = []
        self.biases: list[tuple[Ints, Floats]] = []

    def nodes(self, names: Iterable[str]) -> Ints:
        """Return the places of nodes, `GROUND` for ground; a new name gets the next place."""
        places = self.places
        indices = [GROUND if n == "0" else places.setdefault(n, len(places)) for n in names]
        return np.array(indices, dtype=np.int64)

    def bias(self, rows: Ints, values: Floats) -> None:
        """Add constants to rows, one each."""
        self.biases.append((rows, values))

    def fix(self, node: str, source: str) -> None:
        """Reserve a node's row for an ideal source."""
        if node == "0" or self.places[node] in self.fixed:
            message = f"{source} drives a node whose voltage another ideal source determines"
            raise EngineError(message)
        self.fixed.add(self.places[node])

    def matrix(self, matrix: ResistorMatrix) -> None:
        """Stamp a resistor matrix: arrays off the diagonal, sums on the diagonal."""
        G = np.divide(1.0, matrix.ohms)
        G, negative = (G, matrix.negative) if matrix.by_column else (G.T, matrix.negative.T)
        live = np.flatnonzero(G.any(axis=1))  # the node of an empty row may not exist
        G, negative = G[live], negative[live]
        sinks = self.nodes(matrix.sinks[k] for k in live.tolist())
        G = np.concatenate([np.where(negative, 0.0, G), np.where(negative, G, 0.0)], axis=1)
        used, names = np.flatnonzero(G.any(axis=0)), (*matrix.plus, *matrix.minus)
        drivers = self.nodes(names[d] for d in used.tolist())
        G = np.ascontiguousarray(G[:, used])
        # Sorted, so that the sums of mirrored rows are equal to the bit.
        for places, axis in ((sinks, 1), (drivers, 0)):
            self.currents.add(places, places, -np.sort(G, axis=axis).sum(axis=axis))
        driven = drivers != GROUND
        self.couplings.append((sinks, drivers[driven], G[:, driven]))

    def opamps(self, pins: Ints) -> Devices:
        """Stamp the op-amp macromodels; `pins` (P, 3) are plus, minus and output.

        Return the input stages and clamps of op-amps at the large-signal level.
        """
        models = self.circuit.models
        which = {name: k for k, name in enumerate(models)}
        chosen = np.array([which[cell.model] for cell in self.circuit.opamps], dtype=np.int64)
        figures = np.array([FIGURES(model) for model in models.values()]).reshape(-1, 7)
        gain, gbw, second, leak, between, grounded, resistance = figures[chosen].T
        plus, minus, out = pins.T
        self.currents.branch(plus, minus, -1.0 / leak)
        self.mass.branch(plus, minus, between)
        for pin in (plus, minus):
            self.mass.add(pin, pin, grounded)
        states = self._states(np.isfinite(np.stack([gbw, second], axis=1)))
        limited = self._limited()
        if np.any(plus[limited] != GROUND):
            raise EngineError("an op-amp with limits needs a grounded non-inverting input")
        stages, clamps = self._input_stages(limited, minus), self._clamps(limited, states[:, 0])
        plus, minus = plus.copy(), minus.copy()
        plus[limited], minus[limited] = stages.output, GROUND
        # The signal so far is factor (z[plus] - z[minus]).
        rate = 2.0 * np.pi * gbw
        plus, minus = self._lag(states[:, 0], rate / gain, rate, plus, minus)
        factor = np.where(states[:, 0] != GROUND, 1.0, gain)
        rate = 2.0 * np.pi * second
        plus, minus = self._lag(states[:, 1], rate, rate * factor, plus, minus)
        factor = np.where(states[:, 1] != GROUND, 1.0, factor)
        ideal = resistance == 0.0
        g = np.divide(1.0, resistance, out=np.ones_like(resistance), where=~ideal)
        for entries, rows in (
            (self.laws, np.where(ideal, out, GROUND)),
            (self.currents, np.where(ideal, GROUND, out)),
        ):
            entries.add(rows, plus, factor * g)
            entries.add(rows, minus, -factor * g)
            entries.add(rows, out, -g)
        return _together(stages, clamps)

    def _limited(self) -> Ints:
        """Return which op-amps are at the large-signal level."""
        models = self.circuit.models
        return np.flatnonzero([models[cell.model].large_signal for cell in self.circuit.opamps])

    def _devices(
        self, kind: str, which: Ints, inputs: Ints, size: list[float], width: list[float]
    ) -> Devices:
        """Return devices of op-amps whose outputs are new unknowns, named after their kind."""
        cells = self.circuit.opamps
        places = self.nodes(f"x{cells[k].name}.{kind}" for k in which.tolist())
        self.fixed.update(places.tolist())
        return Devices((kind,) * which.size, inputs, places, np.array(size), np.array(width))

    def _input_stages(self, which: Ints, minus: Ints) -> Devices:
        """Return the stages ``d = -V tanh(v- / V)``: nearly ``v+ - v-`` for small v-, at v+ = 0."""
        models = [self.circuit.models[self.circuit.opamps[k].model] for k in which.tolist()]
        ranges = [model.input_range for model in models]
        return self._devices(INPUT_STAGE, which, minus[which], ranges, ranges)

    def _clamps(self, which: Ints, first: Ints) -> Devices:
        """Stamp the clamps of the first poles `first` (P,) of op-amps with a finite swing."""
        c = self.circuit
        models = {k: c.models[c.opamps[k].model] for k in which.tolist()}
        swings = {k: model.swing(c.supply) for k, model in models.items()}
        which = np.array([k for k in which.tolist() if np.isfinite(swings[k])], dtype=np.int64)
        rates = [models[k].slew_rate for k in which.tolist()]
        widths = [swings[k] / KNEE for k in which.tolist()]
        clamps = self._devices(CLAMP, which, first[which], rates, widths)
        self.laws.add(first[which], clamps.output, np.ones(len(which)))
        return clamps

    def _states(self, has_state: Bools) -> Ints:
        """Return the places of the op-amps' poles, (P, 2); `GROUND` for a pole without a state."""
        names = [
            f"x{cell.name}.p{k}" if exists else "0"
            for cell, pair in zip(self.circuit.opamps, has_state.tolist(), strict=True)
            for k, exists in enumerate(pair, 1)
        ]
        return self.nodes(names).reshape(-1, 2)

    def _lag(
        self, x: Ints, rate: Floats, gain: Floats, plus: Ints, minus: Ints
    ) -> tuple[Ints, Ints]:
        """Add states ``x' = -rate x + gain (z[plus] - z[minus])``; return the signal's new places.

        Where `x` is `GROUND`, no state is added and the places do not change.
        """
        self.mass.add(x, x, np.ones(len(x)))
        self.laws.add(x, plus, gain)
        self.laws.add(x, minus, -gain)
        self.laws.add(x, x, -rate)
        absent = x == GROUND
        return np.where(absent, plus, x), np.where(absent, minus, GROUND)

    def sources(self, devices: Devices) -> tuple[Floats, Floats]:
        """Stamp the laws of ideal sources; return b: switched and constant part, (size,)."""
        c, size = self.circuit, len(self.places)
        nodes = self.nodes(v.node for v in c.voltages)
        constant = np.zeros(size)
        for rows, values in self.biases:
            np.add.at(constant, rows[rows != GROUND], values[rows != GROUND])
        constant[nodes] = [v.volts for v in c.voltages]
        for places in (nodes, devices.output):
            self.laws.add(places, places, -np.ones(len(places)))
        into = self.nodes(i.node for i in c.currents)
        amps = np.array([i.amps for i in c.currents], dtype=np.float64)
        switched = np.zeros(size)
        np.add.at(switched, into[into != GROUND], amps[into != GROUND])
        switched[list(self.fixed)] = 0.0
        return switched, constant


def _claim_rows(stamper: _Stamper) -> None:
    c = stamper.circuit
    for source in c.voltages:
        stamper.fix(source.node, source.name)
    for amplifier in c.amplifiers:
        stamper.fix(amplifier.output, amplifier.name)
    ideal = {name for name, model in c.models.items() if model.output_resistance == 0.0}
    for cell in c.opamps:
        if cell.model in ideal:
            stamper.fix(cell.output, cell.name)


def _devices(stamper: _Stamper) -> Devices:
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
    imported = [cell for cell in circuit.opamps if circuit.linear_model(cell) is not None]
    circuit = replace(circuit, opamps=tuple(c for c in circuit.opamps if c not in imported))
    stamper = _Stamper(circuit)
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
    _claim_rows(stamper)
    for matrix in circuit.matrices:
        stamper.matrix(matrix)
    node_count = len(stamper.places)
    stamp_imported(stamper, imported, foreign)
    transistors = stamp_transistors(stamper, legs.reshape(-1, 3))
    devices = _together(devices, transistors, stamper.opamps(wired))
    ohms = np.array([part.ohms for part in circuit.resistors], dtype=np.float64)
    stamper.currents.branch(resistors[0::2], resistors[1::2], -1.0 / ohms)
    farads = np.array([part.farads for part in circuit.capacitors], dtype=np.float64)
    stamper.mass.branch(capacitors[0::2], capacitors[1::2], farads)
    return _finish(stamper, node_count, devices)


def _together(*parts: Devices) -> Devices:
    """Join devices."""
    kinds = tuple(kind for part in parts for kind in part.kinds)
    fields = ("input", "output", "u_scale", "v_scale")
    return Devices(kinds, *(np.concatenate([getattr(p, f) for p in parts]) for f in fields))


def _finish(stamper: _Stamper, node_count: int, devices: Devices) -> Descriptor:
    switched, constant = stamper.sources(devices)
    board = np.append(np.ones(len(stamper.places), dtype=np.bool_), False)
    determined = np.zeros(len(stamper.places), dtype=np.bool_)
    determined[list(stamper.fixed)] = True
    free = board & np.append(~determined, False)
    laws, currents = stamper.laws.triplets(board), stamper.currents.triplets(free)
    couplings = []
    for sinks, drivers, G in stamper.couplings:
        live = sinks != GROUND
        if determined[sinks[live]].any():
            raise EngineError("an ideal source drives a summing node of a resistor matrix")
        couplings.append(Coupling(sinks[live], drivers, G[live], ~determined[drivers]))
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
    )
