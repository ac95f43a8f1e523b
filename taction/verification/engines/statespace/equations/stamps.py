"""Stamp the descriptor equations of a `Circuit` (see `descriptor`).

Coils and sources between any two nodes are those of modified nodal analysis without needless
unknowns. A source of voltage (V, E, H) determines the voltage of one of its nodes, whose row states
its law, and its current balance is added to that of the other node: both are one node to all
currents. So its own current is no unknown, and a capacitor at an ideal source raises no index. Only
a current that controls another source is an unknown, ``i(card)``; its row is the balance of the
node that its source determines. A coil has its current as state.

An op-amp is ``A(s) = A0 / ((1 + s/p1)(1 + s/p2))`` with ``p1 = 2 pi gbw / A0``: an integrator
``x1' = -p1 x1 + 2 pi gbw e``, a lag ``x2' = p2 (x1 - x2)``, and a voltage source behind the output
resistance. The input ``e = v+ - v-`` has the DC errors of `spice_models.opamp` where the model has
them. At the large-signal level e goes through a tanh, a clamp holds x1, and the output current is
limited.

A bipolar transistor has linear parts around two exponential devices. With ``s = 1`` (NPN) or -1
(PNP), the junction voltages ``v_f = s (v_b - v_e')`` and ``v_r = s (v_b - v_c)`` at the inner
emitter e', and the currents ``F = IS exp(v_f / V_T)`` and ``R = IS exp(v_r / V_T)``, the currents
into collector, base and emitter are s times

    F - R (1 + 1/BR) + IS/BR,    (F - IS)/BF + (R - IS)/BR,    -F (1 + 1/BF) + R + IS/BF.

Both junctions are unknowns ``v - V_T ln(SCALE / IS)``, so that they are near 0 at `SCALE`, and the
exponentials are devices with the outputs ``-U0 F / SCALE`` and ``-U0 R / SCALE``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, port_matrices, with_linear_models
from taction.netlist_gen.board.parts import OpAmpCell
from taction.spice_models.branches import Branch, Source
from taction.spice_models.opamp import KNEE, OVERDRIVE, OpAmp
from taction.spice_models.transistor import thermal_voltage
from taction.system.array_types import Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import (
    CLAMP,
    INPUT_STAGE,
    LIMITER,
)
from taction.verification.engines.statespace.equations.descriptor import (
    GROUND,
    Coupling,
    Descriptor,
    Devices,
    Stamper,
)

Signal = list[tuple[int, float]]  # unknowns with their gains; a sum


def _claim_rows(stamper: Stamper) -> None:
    c = stamper.circuit
    for source in c.voltages:
        stamper.fix(source.node, source.name)
    for amplifier in c.amplifiers:
        stamper.fix(amplifier.output, amplifier.name)
    for cell in c.opamps:
        if c.models[cell.model].output_resistance == 0.0:
            stamper.fix(cell.output, cell.name)


def stamp(circuit: Circuit) -> Descriptor:
    """Return the descriptor equations of a board, in SI base units.

    EngineError: two ideal sources drive one node, or an amplifier's input is grounded.
    """
    if circuit.has_imported:
        circuit = with_linear_models(circuit)
    stamper, c = Stamper(circuit), circuit
    if any(part.input == "0" for part in c.amplifiers):
        raise EngineError("a signal amplifier's input is grounded")
    for name in (
        *(pin for cell in c.opamps for pin in (cell.noninverting, cell.inverting, cell.output)),
        *(pin for part in c.amplifiers for pin in (part.input, part.output)),
        *(pin for cell in c.transistors for pin in (cell.collector, cell.base, cell.emitter)),
        *(end for part in c.resistors for end in (part.a, part.b)),
        *(end for part in c.capacitors for end in (part.a, part.b)),
        *(source.node for source in c.currents),
        *(source.node for source in c.voltages),
        *(node for part in c.branches for node in part.nodes),
    ):
        stamper.node(name)
    for amplifier in c.amplifiers:
        places = stamper.node(amplifier.input), stamper.node(amplifier.output)
        stamper.devices.append((amplifier.kind, *places, amplifier.u_scale, amplifier.v_scale))
    _claim_rows(stamper)
    for matrix in port_matrices(circuit):
        stamper.matrix(matrix)
    node_count = len(stamper.places)
    stamp_transistors(stamper)
    for cell in circuit.opamps:
        _stamp_opamp(stamper, cell, circuit.models[cell.model])
    for resistor in circuit.resistors:
        ends = stamper.node(resistor.a), stamper.node(resistor.b)
        stamper.currents.branch(*ends, -1.0 / resistor.ohms)
    for capacitor in circuit.capacitors:
        stamper.mass.branch(stamper.node(capacitor.a), stamper.node(capacitor.b), capacitor.farads)
    rows = None
    if circuit.branches:
        rows = _Branches(stamper, circuit.branches).stamp()
    return _finish(stamper, node_count, rows)


def _finish(stamper: Stamper, node_count: int, moved: Ints | None) -> Descriptor:
    switched, constant = stamper.sources()
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
        mass=stamper.mass.triplets(free, moved),
        local=stamper.laws.triplets(board).joined(stamper.currents.triplets(free, moved)),
        couplings=tuple(couplings),
        switched=switched,
        constant=constant,
        determined=determined,
        devices=Devices.of(stamper.devices),
        places=stamper.places,
        has_branches=bool(stamper.circuit.branches),
        moved=stamper.moved,
    )


def _scaled(signal: Signal, factor: float) -> Signal:
    return [(place, factor * gain) for place, gain in signal]


def _stamp_opamp(stamper: Stamper, cell: OpAmpCell, model: OpAmp) -> None:
    """Stamp the inputs of an op-amp, its input stage, both poles and its output."""
    plus, minus, out = map(stamper.node, (cell.noninverting, cell.inverting, cell.output))
    currents, laws, name = stamper.currents, stamper.laws, f"x{cell.name}"
    currents.branch(plus, minus, -1.0 / model.input_resistance)
    stamper.mass.branch(plus, minus, model.differential_capacitance)
    for pin, amps in zip((plus, minus), model.input_currents, strict=True):
        stamper.mass.add(pin, pin, model.input_capacitance)
        stamper.constant_currents.append((pin, -amps))
    first, second = (
        stamper.node(f"{name}.{part}" if math.isfinite(hertz) else "0")
        for part, hertz in (("p1", model.gbw), ("p2", model.second_pole))
    )
    half, offset = 0.5 * model.rejection_error, model.input_offset
    signal: Signal = [(plus, 1.0 + half), (minus, half - 1.0)]
    if model.large_signal:
        stage, offset = _input_stage(stamper, name, signal, offset, model.input_range), 0.0
        signal = [(stage, 1.0)]
        swing = model.swing(stamper.circuit.supply)
        if math.isfinite(swing):
            clamp = stamper.device(CLAMP, first, f"{name}.clamp", model.slew_rate, swing / KNEE)
            laws.add(first, clamp, 1.0)
    gain = model.dc_gain
    if first != GROUND:
        rate = 2.0 * math.pi * model.gbw
        _law(stamper, first, _scaled(signal, rate), rate * offset)
        laws.add(first, first, -rate / gain)
        signal, gain, offset = [(first, 1.0)], 1.0, 0.0
    if second != GROUND:
        rate = 2.0 * math.pi * model.second_pole
        _law(stamper, second, _scaled(signal, rate * gain), rate * gain * offset)
        laws.add(second, second, -rate)
        signal, gain, offset = [(second, 1.0)], 1.0, 0.0
    for place in {first, second} - {GROUND}:
        stamper.mass.add(place, place, 1.0)
    if model.is_current_limited:
        _limited_output(stamper, name, out, signal[0][0], model)
        return
    siemens = 1.0 / (model.output_resistance or 1.0)
    entries, constants = (
        (currents, stamper.constant_currents)
        if model.output_resistance
        else (laws, stamper.constant_laws)
    )
    for place, share in _scaled(signal, gain * siemens):
        entries.add(out, place, share)
    entries.add(out, out, -siemens)
    constants.append((out, gain * siemens * offset))


def _law(stamper: Stamper, row: int, signal: Signal, constant: float) -> None:
    """Add a signal and a constant to the law of a row."""
    for place, gain in signal:
        stamper.laws.add(row, place, gain)
    stamper.constant_laws.append((row, constant))


def _input_stage(stamper: Stamper, name: str, signal: Signal, offset: float, volts: float) -> int:
    """Add the input stage ``V tanh(e / V)`` of a signal e; return the place of its output.

    A stage of -e inverts. Where e is -v- alone, v- is its input.
    """
    (plus, _), (place, gain) = signal
    if plus != GROUND or gain != -1.0 or offset != 0.0:
        place = stamper.unknown(f"{name}.difference")
        _law(stamper, place, _scaled(signal, -1.0), -offset)
        stamper.laws.add(place, place, -1.0)
    return stamper.device(INPUT_STAGE, place, f"{name}.stage", volts, volts)


def _limited_output(stamper: Stamper, name: str, out: int, driven: int, model: OpAmp) -> None:
    """Stamp an output with a largest current.

    The unknown ``d = v_out + b - x`` is the voltage over the output resistance, and b the drop of
    the limiter behind it.
    """
    drop, ohms = stamper.unknown(f"{name}.drop"), model.output_resistance
    size = OVERDRIVE * stamper.circuit.supply
    limiter = stamper.device(LIMITER, drop, f"{name}.limiter", size, ohms * model.output_current)
    _law(stamper, drop, [(out, 1.0), (limiter, 1.0), (driven, -1.0), (drop, -1.0)], 0.0)
    stamper.currents.add(out, drop, -1.0 / ohms)


def gain_stage(model: OpAmp, cell: OpAmpCell, descriptor: Descriptor) -> tuple[int, float]:
    """Return the row that the input voltage of an op-amp drives, and its gain there."""
    if math.isfinite(model.gbw):
        return descriptor.place(f"x{cell.name}.p1"), 2.0 * math.pi * model.gbw
    return descriptor.place(cell.output), model.dc_gain / (model.output_resistance or 1.0)


SCALE = 1e-4  # A


def stamp_transistors(stamper: Stamper) -> None:
    """Stamp all transistors: two exponentials each, with linear parts."""
    volts = thermal_voltage(stamper.circuit.temperature)
    for cell in stamper.circuit.transistors:
        model = stamper.circuit.transistor_models[cell.model]
        collector, base, emitter = map(stamper.node, (cell.collector, cell.base, cell.emitter))
        inner, sign, unit = stamper.node(f"q{cell.name}.e"), model.sign, stamper.circuit.value("U0")
        stamper.currents.branch(emitter, inner, -1.0 / model.emitter_resistance)
        stamper.mass.branch(base, inner, model.emitter_capacitance)
        stamper.mass.branch(base, collector, model.collector_capacitance)
        outputs = []
        for part, far in (("f", inner), ("r", collector)):
            junction = stamper.unknown(f"q{cell.name}.v{part}")
            law: Signal = [(base, sign), (far, -sign), (junction, -1.0)]
            _law(stamper, junction, law, -volts * math.log(SCALE / model.saturation_current))
            name = f"q{cell.name}.{part}"
            outputs.append(stamper.device("exponential", junction, name, unit, volts))
        # A row states the currents into its node; z[f] = -U0 F / SCALE.
        BF, BR, IS = model.forward_gain, model.reverse_gain, model.saturation_current
        for row, of_f, of_r, constant in (
            (collector, 1.0, -(1.0 + 1.0 / BR), IS / BR),
            (base, 1.0 / BF, 1.0 / BR, -IS / BF - IS / BR),
            (inner, -(1.0 + 1.0 / BF), 1.0, IS / BF),
        ):
            for output, share in zip(outputs, (of_f, of_r), strict=True):
                stamper.currents.add(row, output, sign * SCALE / unit * share)
            stamper.constant_currents.append((row, -sign * constant))


def transistor_currents(circuit: Circuit, descriptor: Descriptor, values: Floats) -> Floats:
    """Return the currents into collector and base of every transistor, A, (2, Q).

    `values` (size,) are the unknowns.
    """
    amps = -SCALE / circuit.value("U0")
    found = []
    for cell in circuit.transistors:
        model = circuit.transistor_models[cell.model]
        F, R = (amps * values[descriptor.place(f"q{cell.name}.{part}")] for part in ("f", "r"))
        back = (R - model.saturation_current) / model.reverse_gain
        base = (F - model.saturation_current) / model.forward_gain + back
        found.append((model.sign * (F - R - back), model.sign * base))
    return np.array(found).reshape(-1, 2).T


def current_of(card: str) -> str:
    """Return the name of the unknown that is the current of a card, from its node `a` to `b`."""
    return f"i({card})"


class _Branches:
    """Stamps of all branches; `rows` is the row that takes the current into each place.

    EngineError: sources of voltage that form a loop, or a card that controls another one and is not
      there.
    """

    def __init__(self, stamper: Stamper, parts: tuple[Branch, ...]) -> None:
        self.stamper, self.parts = stamper, parts
        # A law of a row; a current out of the node `back` into a row, or to a current's balance.
        self._state, self._add = stamper.laws.add, stamper.currents.add
        self.values = {part.card: part.value for part in parts}
        self.sensed = {part.control[0]: part.card for part in parts if part.letter in "FH"}
        for card, by in self.sensed.items():
            if card not in self.values:
                raise EngineError(f"{by} is controlled by {card}, which is no source")
        coils = [part.card for part in parts if part.letter == "L"]
        names = [current_of(card) for card in dict.fromkeys([*self.sensed, *coils])]
        self.currents = {name: stamper.node(name) for name in names}
        self.rows = list(range(len(stamper.places)))

    def stamp(self) -> Ints:
        """Stamp everything; return the rows that take the currents into places, ground's last."""
        for part, child, other in self._forest():
            self._law(part, child, other)
        for part in self.parts:
            self._flow(part)
        stamper = self.stamper
        stamper.moved = {k: row for k, row in enumerate(self.rows) if row != k}
        rows = [*self.rows, GROUND]
        stamper.constant_currents[:] = [(rows[i], value) for i, value in stamper.constant_currents]
        return np.array(rows, dtype=np.int64)

    def _ends(self, part: Branch) -> tuple[int, int]:
        return self.stamper.node(part.a), self.stamper.node(part.b)

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
            before, step = _steps(part)
            stamper.constant_laws.append((child, sign * before))
            stamper.switched.append((child, sign * step))
        elif part.letter == "E":
            for place, gain in self._controls(part):
                self._state(child, place, sign * gain)
        else:
            self._state(child, self._current(part.control[0]), sign * self.values[part.card])

    def _controls(self, part: Branch) -> Iterator[tuple[int, float]]:
        for node, gain in zip(part.control, (part.value, -part.value), strict=True):
            yield self.stamper.node(node), gain

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
                mass.add(current, current, value)
                self._state(current, a, 1.0)
                self._state(current, b, -1.0)
                self._through(part, current, 1.0)
            case "K":
                henries = value * math.sqrt(self.values[part.a] * self.values[part.b])
                one, other = (self._current(card) for card in (part.a, part.b))
                mass.add(one, other, henries)
                mass.add(other, one, henries)
            case "I":
                self._source(part)
            case "G":
                for place, gain in self._controls(part):
                    self._through(part, place, gain)
            case "Y":  # what flows out of `part.a` is on the left of ``M z' = K z``
                a, b = self._ends(part)
                for place, gain in self._controls(part):
                    mass.add(a, place, gain, b)
                    mass.add(b, place, -gain, a)
            case "F":
                self._through(part, self._current(part.control[0]), value)

    def _source(self, part: Branch) -> None:
        rows = [*self.rows, GROUND]  # which take the currents into places; ground stays ground
        (a, b), (before, step) = self._ends(part), _steps(part)
        for place, sign in ((a, -1.0), (b, 1.0)):
            self.stamper.constant_currents.append((place, sign * before))
            self.stamper.switched.append((rows[place], sign * step))


def _steps(part: Branch) -> tuple[float, float]:
    """Return what a source has before t = 0, and what is switched on then."""
    return (part.before, part.step) if isinstance(part, Source) else (part.value, 0.0)
