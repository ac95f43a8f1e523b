"""The antilog stage of a channel as parts: a matched pair, two op-amps and an input divider.

The collector currents of two equal transistors with one emitter node have the ratio
``exp((v_b2 - v_b1) / V_T)`` (NPN; PNP: of the opposite sign). One op-amp drives the emitters so
that transistor 1 carries I_ref, the divider sets one base to ``v V_T / Ve``, the other base is on
ground, so transistor 2 carries ``I_ref exp(v / Ve)``. The second op-amp turns this current into a
voltage by ``R_t = U0 / I_ref``. `docs/network.md` derives it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.bill_of_materials import nearest, preferred
from taction.netlist_gen.board.circuit import GROUND, Circuit, Role
from taction.netlist_gen.board.parts import (
    Capacitor,
    Resistor,
    SignalAmplifier,
    TransistorCell,
    VoltageSource,
)
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.entries import Parts
from taction.spice_models.opamp import OpAmp
from taction.spice_models.transistor import Transistor, load_pairs, thermal_voltage
from taction.system.errors import Complaint, InputError

REFERENCE, REFERENCE_VOLTS = "reference", 5.0


@dataclass(frozen=True, slots=True)
class AntilogStage:
    """The values of the parts of every stage, ohm and F; a capacitor of 0 is left out."""

    pair: Transistor
    divider: float  # from v to the divided base
    base: float  # from there to ground
    reference: float  # from the reference voltage to collector 1
    emitter: float  # from the reference op-amp to the emitters
    output: float  # R_t
    reference_capacitor: float  # across the reference op-amp
    output_capacitor: float  # across R_t

    @classmethod
    def of(cls, scene: Scene, opamp: OpAmp) -> AntilogStage:
        """Choose the parts for a scene; InputError for a slope below the thermal voltage."""
        if scene.analysis.initial != "rest":
            text = (
                "transistors start at their operating point; expected 'rest' with antilog 'device'"
            )
            raise InputError(scene.file, Complaint("analysis.initial", "'zero'", text))
        design, choice = scene.design, scene.design.antilog
        pair = load_pairs()[choice.transistors]
        volts = thermal_voltage(choice.nominal_temperature)
        series = design.resistor_series
        ratio = (design.exponential_slope or 1.0) / volts - 1.0
        if not ratio > 0.0:
            text = f"a divider only reduces v: must be above the thermal voltage of {volts:.5g} V"
            slope = f"{design.exponential_slope} V"
            raise InputError(scene.file, Complaint("design.exponential_slope", slope, text))
        emitter = preferred(choice.emitter_resistance, series)
        output = preferred(design.unit_voltage / choice.reference_current, series)
        node = design.stray_capacitance + opamp.input_capacitance + opamp.differential_capacitance
        node += pair.collector_capacitance
        capacitors = [compensation(ohms, opamp.gbw, node) for ohms in (emitter, output)]
        first, second = nearest(np.array(capacitors), design.capacitor_series).tolist()
        return cls(
            pair=pair,
            divider=preferred(choice.divider_resistance * ratio, series),
            base=preferred(choice.divider_resistance, series),
            reference=preferred(REFERENCE_VOLTS / choice.reference_current, series),
            emitter=emitter,
            output=output,
            reference_capacitor=first,
            output_capacitor=second,
        )

    def place(self, parts: Parts, n: int) -> str:
        """Place the stage of channel `n`; return its output: -u of a PNP pair, +u of an NPN pair.

        The divider is at the base at which the output current rises with v.
        """
        npn = self.pair.polarity == "npn"
        source, output = f"v_{n}", f"u_{n}" if npn else f"a_{n}"
        base, emitters, collector, drive, current = (f"{letter}_{n}" for letter in "beydt")
        with parts.stated(Role.STAGE):
            if n == 1:
                volts = self.pair.sign * REFERENCE_VOLTS
                parts.voltages.append(VoltageSource(REFERENCE, REFERENCE, volts))
            parts.opamp(drive, collector, drive)
            parts.opamp(output, current, output)
            parts.resistors += [
                Resistor(f"div_{n}", source, base, self.divider),
                Resistor(f"base_{n}", base, GROUND, self.base),
                Resistor(f"ref_{n}", REFERENCE, collector, self.reference),
                Resistor(f"em_{n}", drive, emitters, self.emitter),
                Resistor(f"out_{n}", output, current, self.output),
            ]
            if self.reference_capacitor > 0.0:
                parts.capacitors += [
                    Capacitor(f"ref_{n}", drive, collector, self.reference_capacitor),
                    Capacitor(f"out_{n}", output, current, self.output_capacitor),
                ]
            first, second = (GROUND, base) if npn else (base, GROUND)
            parts.transistors += [
                TransistorCell(f"ref_{n}", self.pair.name, collector, first, emitters),
                TransistorCell(f"out_{n}", self.pair.name, current, second, emitters),
            ]
        return output


def compensation(ohms: float, gbw: float, node: float) -> float:
    """Return the capacitor from the output of an op-amp to its inverting input, F.

    The input has a capacitance `node` to ground, and the output drives it through `ohms` as well.
    With ``g = 1 / ohms`` the gain of the loop is ``w_t / s (s C + g) / (s (C + node))``. The C
    returned puts its zero at half of the crossover, ``C² / (C + node) = 2 g / w_t``: a phase margin
    of atan 2 = 63 degrees without further poles. It is 0 for an op-amp without poles.

    Examples
    --------
    >>> C = compensation(1e4, 1e6, 45e-12)
    >>> round(C**2 / (C + 45e-12) * 1e4 * 2e6 * math.pi, 9)
    2.0
    """
    if math.isinf(gbw):
        return 0.0
    share = 1.0 / (ohms * 2.0 * math.pi * gbw)
    return share + math.sqrt(share**2 + 2.0 * share * node)


def with_ideal_stages(circuit: Circuit) -> Circuit:
    """Return `circuit` with the function ``U0 exp(v/Ve)`` itself as its stages."""
    if not circuit.transistors:
        return circuit
    stage, scales = circuit.named(Role.STAGE), (circuit.value("U0"), circuit.value("Ve"))
    return replace(
        circuit,
        opamps=tuple(cell for cell in circuit.opamps if cell.card not in stage),
        amplifiers=tuple(
            SignalAmplifier(
                output.node,
                circuit.amplifier,
                node,
                output.node,
                -output.sign * scales[0],
                scales[1],
            )
            for node, output in zip(circuit.signal_nodes, circuit.outputs, strict=True)
        ),
        resistors=tuple(part for part in circuit.resistors if part.card not in stage),
        capacitors=tuple(part for part in circuit.capacitors if part.card not in stage),
        voltages=tuple(source for source in circuit.voltages if source.card not in stage),
        transistors=(),
        transistor_models={},
    )
