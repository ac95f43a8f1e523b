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

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import OpAmpCell
from taction.spice_models.opamp import KNEE, OVERDRIVE, OpAmp
from taction.spice_models.transistor import thermal_voltage
from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.amplifier_gains import (
    CLAMP,
    INPUT_STAGE,
    LIMITER,
)
from taction.verification.engines.statespace.equations.descriptor import (
    GROUND,
    Descriptor,
    Stamper,
)

Signal = list[tuple[int, float]]  # unknowns with their gains; a sum


def _scaled(signal: Signal, factor: float) -> Signal:
    return [(place, factor * gain) for place, gain in signal]


def stamp_opamps(stamper: Stamper) -> None:
    """Stamp the op-amps of a circuit."""
    for cell in stamper.circuit.opamps:
        _stamp_opamp(stamper, cell, stamper.circuit.models[cell.model])


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
KIND = "exponential"


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
            outputs.append(stamper.device(KIND, junction, f"q{cell.name}.{part}", unit, volts))
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
