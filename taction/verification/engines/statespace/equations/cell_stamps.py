"""Stamp op-amps and transistors.

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
import operator
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import OpAmpCell
from taction.spice_models.opamp import KNEE, OVERDRIVE, OpAmp
from taction.spice_models.transistor import thermal_voltage
from taction.system.array_types import Bools, Floats, Ints
from taction.verification.engines.statespace.equations.amplifier_gains import (
    CLAMP,
    INPUT_STAGE,
    LIMITER,
)
from taction.verification.engines.statespace.equations.descriptor import (
    GROUND,
    Descriptor,
    Devices,
    Stamper,
)

FIGURES = operator.attrgetter(
    "dc_gain",
    "gbw",
    "second_pole",
    "input_resistance",
    "differential_capacitance",
    "input_capacitance",
    "output_resistance",
    "input_offset",
    "rejection_error",
)


@dataclass(frozen=True, slots=True)
class _Signal:
    """Signals ``plus_gain z[plus] - minus_gain z[minus] + offset`` of P op-amps, (P,) each."""

    plus: Ints
    minus: Ints
    plus_gain: Floats
    minus_gain: Floats
    offset: Floats

    def times(self, factor: Floats) -> _Signal:
        """Return the signals times a factor (P,)."""
        gains = (factor * x for x in (self.plus_gain, self.minus_gain, self.offset))
        return _Signal(self.plus, self.minus, *gains)

    def replaced(self, where: Bools | Ints, places: Ints) -> _Signal:
        """Return the signals with the unknowns at `places` as some of them."""
        plus, minus = self.plus.copy(), self.minus.copy()
        plus[where], minus[where] = places, GROUND
        gains = [self.plus_gain.copy(), self.minus_gain.copy(), self.offset.copy()]
        for gain, new in zip(gains, (1.0, 1.0, 0.0), strict=True):
            gain[where] = new
        return _Signal(plus, minus, *gains)


def stamp_opamps(stamper: Stamper, pins: Ints) -> list[Devices]:
    """Stamp the op-amp macromodels; `pins` (P, 3) are plus, minus and output.

    Return the devices of op-amps at the large-signal level.
    """
    return _OpAmps(stamper, pins).stamp() if stamper.circuit.opamps else []


class _OpAmps:
    """The op-amps of a circuit, P of them."""

    def __init__(self, stamper: Stamper, pins: Ints) -> None:
        self.stamper, self.cells = stamper, stamper.circuit.opamps
        self.plus, self.minus, self.out = pins.T
        models = stamper.circuit.models
        which = {name: k for k, name in enumerate(models)}
        self.models = list(models.values())
        self.chosen = np.array([which[cell.model] for cell in self.cells], dtype=np.int64)
        self.limited = self._where(lambda model: model.large_signal)

    def stamp(self) -> list[Devices]:
        """Stamp everything."""
        gain, gbw, second, *impedances, offset, common = self._of_models(FIGURES).T
        leak, between, grounded, resistance = impedances
        self._inputs(leak, between, grounded)
        poles = self._states(np.isfinite(np.stack([gbw, second], axis=1)))
        half = 0.5 * common
        signal = _Signal(self.plus, self.minus, 1.0 + half, 1.0 - half, offset)
        signal, stages = self._input_stages(signal)
        clamps = self._clamps(poles[:, 0])
        gbw, second = (np.where(np.isfinite(f), f, 0.0) for f in (gbw, second))  # no state: ground
        rate = 2.0 * np.pi * gbw
        signal = self._lag(poles[:, 0], rate / gain, signal.times(rate), signal.times(gain))
        rate = 2.0 * np.pi * second
        signal = self._lag(poles[:, 1], rate, signal.times(rate), signal)
        return [stages, clamps, self._outputs(signal, resistance)]

    def _inputs(self, leak: Floats, between: Floats, grounded: Floats) -> None:
        """Stamp the impedances and currents of the inputs."""
        stamper = self.stamper
        stamper.currents.branch(self.plus, self.minus, -1.0 / leak)
        stamper.mass.branch(self.plus, self.minus, between)
        drawn = self._of_models(lambda model: model.input_currents).T
        for pin, amps in zip((self.plus, self.minus), drawn, strict=True):
            stamper.mass.add(pin, pin, grounded)
            stamper.constant_currents.append((pin, -amps))

    def _add(self, rows: Ints, signal: _Signal, *, laws: bool = True) -> None:
        """Stamp signals into rows that state laws, or into current balances."""
        stamper = self.stamper
        entries = stamper.laws if laws else stamper.currents
        constants = stamper.constant_laws if laws else stamper.constant_currents
        entries.add(rows, signal.plus, signal.plus_gain)
        entries.add(rows, signal.minus, -signal.minus_gain)
        constants.append((rows, signal.offset))

    def _of_models(self, figures: Callable[[OpAmp], object]) -> Floats:
        """Return a figure of each op-amp, or several, from its model: (P, ...)."""
        return np.array(list(map(figures, self.models)), dtype=np.float64)[self.chosen]

    def _where(self, has: Callable[[OpAmp], bool]) -> Ints:
        """Return which op-amps have a model of some kind."""
        return np.flatnonzero(self._of_models(has))

    def _unknowns(self, kind: str, which: Ints) -> Ints:
        """Return the places of new unknowns of some op-amps, whose rows state laws."""
        places = self.stamper.nodes(f"x{self.cells[k].name}.{kind}" for k in which.tolist())
        self.stamper.fixed.update(places.tolist())
        return places

    def _devices(
        self, kind: str, which: Ints, inputs: Ints, size: Floats, width: Floats
    ) -> Devices:
        """Return devices of some op-amps whose outputs are new unknowns, named after their kind."""
        return Devices((kind,) * which.size, inputs, self._unknowns(kind, which), size, width)

    def _input_stages(self, signal: _Signal) -> tuple[_Signal, Devices]:
        """Return the signals behind the input stages ``V tanh(e / V)``, and these stages."""
        which, inputs = self.limited, signal.minus[self.limited].copy()
        # A stage of -e inverts. Where e is -v- alone, v- is its input.
        plain = (signal.plus == GROUND) & (signal.minus_gain == 1.0) & (signal.offset == 0.0)
        others = which[~plain[which]]
        places = self._unknowns("difference", others)
        inputs[~plain[which]] = places
        rows = np.full(len(self.chosen), GROUND)
        rows[others] = places
        self._add(rows, signal.times(-np.ones(len(self.chosen))))
        self.stamper.laws.add(places, places, -np.ones(len(places)))
        ranges = self._of_models(lambda model: model.input_range)[which]
        stages = self._devices(INPUT_STAGE, which, inputs, ranges, ranges)
        return signal.replaced(which, stages.output), stages

    def _clamps(self, first: Ints) -> Devices:
        """Stamp the clamps of the first poles `first` (P,) of op-amps with a finite swing."""
        supply = self.stamper.circuit.supply
        which = self._where(lambda m: m.large_signal and math.isfinite(m.swing(supply)))
        rates = self._of_models(lambda model: model.slew_rate)[which]
        widths = self._of_models(lambda model: model.swing(supply) / KNEE)[which]
        clamps = self._devices(CLAMP, which, first[which], rates, widths)
        self.stamper.laws.add(first[which], clamps.output, np.ones(len(which)))
        return clamps

    def _states(self, has_state: Bools) -> Ints:
        """Return the places of the op-amps' poles, (P, 2); `GROUND` for a pole without a state."""
        names = [
            f"x{cell.name}.p{k}" if exists else "0"
            for cell, pair in zip(self.cells, has_state.tolist(), strict=True)
            for k, exists in enumerate(pair, 1)
        ]
        return self.stamper.nodes(names).reshape(-1, 2)

    def _lag(self, x: Ints, rate: Floats, driven: _Signal, signal: _Signal) -> _Signal:
        """Add states ``x' = driven - rate x``; return them, or `signal` where `x` is `GROUND`.

        `driven` is ``rate signal``, rounded once.
        """
        there = x != GROUND
        self.stamper.mass.add(x, x, np.ones(len(x)))
        self._add(x, driven)
        self.stamper.laws.add(x, x, -rate)
        return signal.replaced(there, x[there])

    def _outputs(self, signal: _Signal, resistance: Floats) -> Devices:
        """Stamp the voltage sources behind the output resistances; return the current limiters."""
        limiters = self._limiters(signal)
        ideal = resistance == 0.0
        plain = ~ideal
        plain[self._where(lambda model: model.is_current_limited)] = False
        g = np.divide(1.0, resistance, out=np.ones_like(resistance), where=~ideal)
        driven = signal.times(g)
        for laws, chosen in ((True, ideal), (False, plain)):
            rows = np.where(chosen, self.out, GROUND)
            self._add(rows, driven, laws=laws)
            (self.stamper.laws if laws else self.stamper.currents).add(rows, self.out, -g)
        return limiters

    def _limiters(self, signal: _Signal) -> Devices:
        """Stamp the outputs with a largest current.

        The unknown ``d = v_out + b - x`` is the voltage over the output resistance, and b the drop
        of the limiter behind it.
        """
        which = self._where(lambda model: model.is_current_limited)
        drop, out = self._unknowns("drop", which), self.out[which]
        ohms = self._of_models(lambda model: model.output_resistance)[which]
        volts = ohms * self._of_models(lambda model: model.output_current)[which]
        size = np.full(len(which), OVERDRIVE * self.stamper.circuit.supply)
        limiters = self._devices(LIMITER, which, drop, size, volts)
        laws, ones = self.stamper.laws, np.ones(len(which))
        for places, sign in (
            (out, 1.0),
            (limiters.output, 1.0),
            (signal.plus[which], -1.0),
            (drop, -1.0),
        ):
            laws.add(drop, places, sign * ones)
        self.stamper.currents.add(out, drop, -1.0 / ohms)
        return limiters


def gain_stage(model: OpAmp, cell: OpAmpCell, descriptor: Descriptor) -> tuple[int, float]:
    """Return the row that the input voltage of an op-amp drives, and its gain there."""
    if math.isfinite(model.gbw):
        return descriptor.place(f"x{cell.name}.p1"), 2.0 * math.pi * model.gbw
    return descriptor.place(cell.output), model.dc_gain / (model.output_resistance or 1.0)


SCALE = 1e-4  # A
KIND = "exponential"


def stamp_transistors(stamper: Stamper, pins: Ints) -> Devices:
    """Stamp all transistors; `pins` (Q, 3) are collector, base and emitter.

    Returns
    -------
    Devices
        Two exponentials for each transistor.
    """
    circuit = stamper.circuit
    if not circuit.transistors:
        places, scale = np.zeros(0, dtype=np.int64), np.zeros(0)
        return Devices((), places, places, scale, scale)
    models = [circuit.transistor_models[cell.model] for cell in circuit.transistors]
    sign, IS, BF, BR, RE, CJE, CJC = np.array(
        [
            (
                model.sign, model.saturation_current, model.forward_gain, model.reverse_gain,
                model.emitter_resistance, model.emitter_capacitance, model.collector_capacitance,
            )
            for model in models
        ]
    ).reshape(-1, 7).T  # fmt: skip
    collector, base, emitter = pins.T
    inner, *unknowns = (_unknowns(stamper, part) for part in ("e", "vf", "vr", "f", "r"))
    vf, vr, f, r = unknowns
    for places in unknowns:
        stamper.fixed.update(places.tolist())
    stamper.currents.branch(emitter, inner, -1.0 / RE)
    stamper.mass.branch(base, inner, CJE)
    stamper.mass.branch(base, collector, CJC)
    volts = thermal_voltage(circuit.temperature)
    for junction, far in ((vf, inner), (vr, collector)):
        stamper.laws.add(junction, base, sign)
        stamper.laws.add(junction, far, -sign)
        stamper.laws.add(junction, junction, -np.ones_like(sign))
        stamper.constant_laws.append((junction, -volts * np.log(SCALE / IS)))
    # A row states the currents into its node; z[f] = -U0 F / SCALE.
    per_volt = sign * SCALE / circuit.value("U0")
    for rows, of_f, of_r, constant in (
        (collector, np.ones_like(BF), -(1.0 + 1.0 / BR), IS / BR),
        (base, 1.0 / BF, 1.0 / BR, -IS / BF - IS / BR),
        (inner, -(1.0 + 1.0 / BF), np.ones_like(BR), IS / BF),
    ):
        stamper.currents.add(rows, f, per_volt * of_f)
        stamper.currents.add(rows, r, per_volt * of_r)
        stamper.constant_currents.append((rows, -sign * constant))
    scales = (
        np.full(2 * len(models), circuit.value("U0")),
        np.full(2 * len(models), volts),
    )
    both = np.concatenate([vf, vr]), np.concatenate([f, r])
    return Devices((KIND,) * 2 * len(models), *both, *scales)


def _unknowns(stamper: Stamper, part: str) -> Ints:
    """Return the places of new unknowns, named after their transistor."""
    return stamper.nodes(f"q{cell.name}.{part}" for cell in stamper.circuit.transistors)


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
