"""The macromodel of an op-amp as a netlist object."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from taction.spice_models.opamp import KNEE, OVERDRIVE, THERMAL, OpAmp

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import SubCircuit


PORTS = ("inp", "inn", "out")
"""External nodes of an op-amp's subcircuit: non-inverting input, inverting input, output."""

STAGE_CAPACITANCE = 10e-12
"""Capacitor of each pole, F. It is close to the capacitance of a signal node, so that one set of
tolerances fits the currents and charges of stage and board. Measured (linear board, N = 32, ngspice
46, 500 steps): 550 time points; 697 with stages of 1 Mohm, 889 with stages of 1 kohm, where
currents of amperes make the step control reject more steps. The operating point is the same."""


def opamp_subcircuit(
    model: OpAmp, noninverting_grounded: bool, supply: float = 15.0, noisy: bool = False
) -> SubCircuit:
    """Build the macromodel of one op-amp type with PySpice's object model.

    ``Rd``, ``Cd`` between the inputs, ``Cn`` and ``Cp`` from the inverting and the non-inverting
    input to ground; one stage ``G``, ``R``, ``C`` per pole, the first with the whole DC gain; a
    voltage source ``Eo`` and the output resistance ``Ro`` in series. At the large-signal level, at
    supplies of ±`supply` V, there are ``Ex`` and ``Bd`` before the first stage, and the clamp
    ``Ey``, ``Bc``, ``Gc`` at its output; ``Ez``, ``Bl``, ``El`` limit the output current. A figure
    that is zero or infinite has no card; an op-amp without poles and impedances has only the card
    ``Eo``. If the non-inverting input of all op-amps of this type is on ground, ``Cp`` has no
    effect and no card.

    With `input_errors` of the model the cards of `_errors` are added, and with `noisy`, for a noise
    analysis, those of `_noise`. The resistors of the model
    stand for no resistor of the part, so they then make no noise of their own.
    """
    from PySpice.Spice.Netlist import SubCircuit

    cell = SubCircuit(model.name, *PORTS)
    silent = {"raw_spice": "noisy=0"} if noisy else {}
    _inputs(cell, model, noninverting_grounded, silent)
    plus, gain = _errors(cell, model, noninverting_grounded), float(model.dc_gain)
    if noisy:
        plus = _noise(cell, model, noninverting_grounded, plus)
    control = (plus, "inn")
    if model.large_signal:
        # ngspice cuts a number in a B expression to 11 digits: the range is the gain of E cards.
        cell.VCVS("x", "x", "0", *control, voltage_gain=1.0 / model.input_range)
        cell.BehavioralSource("d", "d", "0", voltage_expression="tanh(V(x))")
        control, gain = ("d", "0"), gain * model.input_range
        _clamp(cell, model, model.swing(supply))
    for index, pole in enumerate((model.first_pole, model.second_pole), start=1):
        if math.isfinite(pole):
            node = f"p{index}"
            resistance = 1.0 / (2.0 * math.pi * pole * STAGE_CAPACITANCE)
            # The current flows from ground into the node at a positive control voltage.
            cell.VCCS(index, "0", node, *control, transconductance=gain / resistance)
            cell.R(index, node, "0", resistance, **silent)
            cell.C(index, node, "0", STAGE_CAPACITANCE)
            control, gain = (node, "0"), 1.0
    if model.output_resistance > 0.0:
        end = _limiter(cell, model, supply) if model.is_current_limited else "out"
        cell.VCVS("o", "e", "0", *control, voltage_gain=gain)
        cell.R("o", "e", end, float(model.output_resistance), **silent)
    else:
        cell.VCVS("o", "out", "0", *control, voltage_gain=gain)
    return cell


def _clamp(cell: SubCircuit, model: OpAmp, swing: float) -> None:
    """Add the clamp of the first stage's output."""
    if math.isfinite(swing):
        cell.VCVS("y", "y", "0", "p1", "0", voltage_gain=KNEE / swing)
        sides = f"tanh(V(y)-{KNEE!r})+tanh(V(y)+{KNEE!r})"
        cell.BehavioralSource("c", "c", "0", voltage_expression=sides)
        drawn = STAGE_CAPACITANCE * model.slew_rate
        cell.VCCS("c", "p1", "0", "c", "0", transconductance=drawn)


def _limiter(cell: SubCircuit, model: OpAmp, supply: float) -> str:
    """Add the limit of the current through ``Ro``; return the node between the two."""
    knee = 2.0 * KNEE
    volts = model.output_current * model.output_resistance
    cell.VCVS("z", "z", "0", "e", "f", voltage_gain=knee / volts)
    above, below = f"V(z)-{knee!r}", f"V(z)+{knee!r}"
    high = f"max({above},0)+ln(1+exp(-abs({above})))"
    low = f"max(-({below}),0)+ln(1+exp(-abs({below})))"
    cell.BehavioralSource("l", "l", "0", voltage_expression=f"{high}-({low})")
    cell.VCVS("l", "f", "out", "l", "0", voltage_gain=OVERDRIVE * supply / knee)
    return "f"


def _inputs(
    cell: SubCircuit, model: OpAmp, noninverting_grounded: bool, silent: dict[str, str]
) -> None:
    """Add the input impedances."""
    if math.isfinite(model.input_resistance):
        cell.R("d", "inp", "inn", float(model.input_resistance), **silent)
    own = float(model.input_capacitance)
    cards = (("d", "inp", "inn", float(model.differential_capacitance)), ("n", "inn", "0", own))
    for *card, farads in (*cards, ("p", "inp", "0", 0.0 if noninverting_grounded else own)):
        if farads > 0.0:
            cell.C(*card, farads)


def _errors(cell: SubCircuit, model: OpAmp, noninverting_grounded: bool) -> str:
    """Add the DC errors of the inputs; return the node that controls the gain in place of ``inp``.

    ``Vos`` is the offset voltage, ``Ecp`` and ``Ecn`` add the common-mode error of each input,
    ``Ibn`` (and ``Ibp``) are the input currents.
    """
    into_plus, into_minus = model.input_currents
    for letter, pin, amps in (("n", "inn", into_minus), ("p", "inp", into_plus)):
        if amps != 0.0 and not (pin == "inp" and noninverting_grounded):
            cell.I(f"b{letter}", pin, "0", amps)
    node = "inp"
    if model.input_offset != 0.0:
        cell.V("os", "inpo", node, model.input_offset)
        node = "inpo"
    half = 0.5 * model.rejection_error
    if half != 0.0:
        if not noninverting_grounded:
            cell.VCVS("cp", "inpc", node, "inp", "0", voltage_gain=half)
            node = "inpc"
        cell.VCVS("cn", "inpd", node, "inn", "0", voltage_gain=half)
        node = "inpd"
    return node


def _noise(cell: SubCircuit, model: OpAmp, noninverting_grounded: bool, plus: str) -> str:
    """Add the sources of noise; return the node that controls the gain in place of `plus`.

    Each source is a resistor between a node of its own and ground. The thermal voltage of ``Rne``
    is the voltage noise, which ``Ene`` adds to `plus` behind the input impedances; the thermal
    current of ``Rnn`` (and ``Rnp``) is the current noise, which ``Gnn`` (``Gnp``) copies into the
    input. The 1/f part of the voltage noise is a current of ``Rne``, too: the density of its model
    ``flicker`` is ``kf |I|^af / f``, with ``af = 0`` whatever the current I.
    """
    if model.current_noise > 0.0:
        resistance = THERMAL / model.current_noise**2
        for letter, pin in (("n", "inn"), ("p", "inp"))[: 1 if noninverting_grounded else 2]:
            node = f"n{letter}"
            cell.R(f"n{letter}", node, "0", resistance)
            cell.VCCS(f"n{letter}", "0", pin, node, "0", transconductance=1.0 / resistance)
    if model.voltage_noise == 0.0:
        return plus
    resistance, flickering = model.voltage_noise**2 / THERMAL, {}
    if model.flicker_noise > 0.0:
        flickering = {"raw_spice": "flicker"}
        cell.model("flicker", "r", kf=model.flicker_noise / resistance**2, af=0)
    cell.R("ne", "ne", "0", resistance, **flickering)
    cell.VCVS("ne", "inpe", plus, "ne", "0", voltage_gain=1.0)
    return "inpe"
