"""Stamps of bipolar transistors: linear parts around two exponential devices each.

With ``s = 1`` (NPN) or -1 (PNP), the junction voltages ``v_f = s (v_b - v_e')`` and
``v_r = s (v_b - v_c)`` at the inner emitter e', and the currents ``F = IS exp(v_f / V_T)`` and
``R = IS exp(v_r / V_T)``, the currents into collector, base and emitter are s times

    F - R (1 + 1/BR) + IS/BR,    (F - IS)/BF + (R - IS)/BR,    -F (1 + 1/BF) + R + IS/BF.

Both junctions are unknowns ``v - V_T ln(SCALE / IS)``, so that they are near 0 at `SCALE`, and the
exponentials are devices with the outputs ``-U0 F / SCALE`` and ``-U0 R / SCALE``.
"""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.spice_models.transistor import thermal_voltage
from taction.system.array_types import Floats, Ints
from taction.verification.engines.statespace.equations.descriptor import Descriptor, Devices
from taction.verification.engines.statespace.equations.stamper import Stamper

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
