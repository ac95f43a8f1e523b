"""Macromodels as netlist objects: the op-amp's subcircuit and the behavioural amplifier's cards."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from spice_models.amplifier import AMPLIFIERS
from spice_models.opamp import OpAmp

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import SubCircuit


class BehaviouralAmplifier(Protocol):
    """What `amplifier_lines` reads of a circuit's signal amplifier."""

    @property
    def name(self) -> str:
        """Names the cards."""

    @property
    def kind(self) -> str:
        """Key of `AMPLIFIERS`."""

    @property
    def input(self) -> str:
        """Node of v."""

    @property
    def output(self) -> str:
        """Node of -u."""

    @property
    def u_scale(self) -> float:
        """U0, V."""

    @property
    def v_scale(self) -> float:
        """Ve, V."""


PORTS = ("inp", "inn", "out")
"""External nodes of an op-amp's subcircuit: non-inverting input, inverting input, output."""

STAGE_CAPACITANCE = 10e-12
"""Capacitor of each pole, F: about what a signal node carries, so a stage's currents and charges
are those of the board and one set of tolerances fits both. Measured (linear board, N = 32, ngspice
46, 500 steps): 550 time points; 697 with stages of 1 Mohm, 889 with 1 kohm, where currents of
amperes make the step control reject more; the operating point is the same to the last digits."""


def opamp_subcircuit(model: OpAmp, *, noninverting_grounded: bool) -> SubCircuit:
    """Build the macromodel of one op-amp type with PySpice's object model.

    ``Rd``, ``Cd`` between the inputs, ``Cn`` and ``Cp`` from the inverting and the non-inverting
    input to ground; one ``G``, ``R``, ``C`` stage a pole, the whole DC gain in the first one; a
    voltage source ``Eo`` and the output resistance ``Ro`` in series. Whatever is zero or infinite
    has no card; an op-amp without poles and impedances is the one card ``Eo``.

    Parameters
    ----------
    model : OpAmp
        The figures.
    noninverting_grounded : bool
        Whether every use of this type has its non-inverting input on ground, where ``Cp`` would
        do nothing and is left out.
    """
    from PySpice.Spice.Netlist import SubCircuit

    cell = SubCircuit(model.name, *PORTS)
    _inputs(cell, model, noninverting_grounded)
    control, gain = ("inp", "inn"), float(model.dc_gain)
    for index, pole in enumerate((model.first_pole, model.second_pole), start=1):
        if math.isfinite(pole):
            node = f"p{index}"
            resistance = 1.0 / (2.0 * math.pi * pole * STAGE_CAPACITANCE)
            # From ground to the node: a positive control voltage pushes current into it.
            cell.VCCS(index, "0", node, *control, transconductance=gain / resistance)
            cell.R(index, node, "0", resistance)
            cell.C(index, node, "0", STAGE_CAPACITANCE)
            control, gain = (node, "0"), 1.0
    if model.output_resistance > 0.0:
        cell.VCVS("o", "e", "0", *control, voltage_gain=gain)
        cell.R("o", "e", "out", float(model.output_resistance))
    else:
        cell.VCVS("o", "out", "0", *control, voltage_gain=gain)
    return cell


def _inputs(cell: SubCircuit, model: OpAmp, noninverting_grounded: bool) -> None:
    """Add the input impedances that exist."""
    if math.isfinite(model.input_resistance):
        cell.R("d", "inp", "inn", float(model.input_resistance))
    if model.differential_capacitance > 0.0:
        cell.C("d", "inp", "inn", float(model.differential_capacitance))
    if model.input_capacitance > 0.0:
        farads = float(model.input_capacitance)
        cell.C("n", "inn", "0", farads)
        if not noninverting_grounded:
            cell.C("p", "inp", "0", farads)


def amplifier_lines(stage: BehaviouralAmplifier) -> tuple[str, ...]:
    """Return the lines of one stage, ``V(output) = -u_scale g(V(input) / v_scale)``.

    One ``B`` card; ngspice cuts a literal in a B expression to 11 digits, so a `v_scale` other
    than 1 V becomes an ``E`` card before it and a `u_scale` other than 1 V one after it (cards
    ``Ex`` and ``Eu`` with the stage's name, nodes ``{name}_x`` and ``{name}_g``), whose gains keep
    every digit.

    Raises
    ------
    ValueError
        For a kind without a behavioural source.
    """
    expression = AMPLIFIERS[stage.kind].expression
    if not expression:
        raise ValueError(f"kind = {stage.kind!r}: an op-amp stage, it has no behavioural source")
    name, before, after = stage.name, [], []
    control, target, sign = stage.input, stage.output, "-"
    if stage.v_scale != 1.0:
        control = f"{name}_x"
        before.append(f"Ex{name} {control} 0 {stage.input} 0 {1.0 / stage.v_scale!r}")
    if stage.u_scale != 1.0:
        target, sign = f"{name}_g", ""
        after.append(f"Eu{name} {stage.output} 0 {target} 0 {-stage.u_scale!r}")
    value = expression.format(x=f"V({control})")
    return (*before, f"B{name} {target} 0 V={sign}{value}", *after)
