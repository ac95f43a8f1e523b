"""The numbers of a design: lam from R, or R from lam, and the op-amp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Scalings
from taction.netlist_gen.board.imported_opamp import imported_opamp
from taction.netlist_gen.board.preferred_values import nearest
from taction.netlist_gen.scene.fields import LARGE, LEAST, MOST, SMALL
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.spice_models.opamp import OpAmp
from taction.spice_models.presets import FIGURES, INPUT_ERRORS, derive, load_presets
from taction.system.errors import Complaint, InputError


def make_scalings(scene: Scene) -> Scalings:
    """Return the design's numbers with R from lam, or lam from R.

    ``lam = 1 / (R s G0²)`` for linear amplifiers (eq (21) corrected) and
    ``lam = 2 Ve / (R s G0² U0)`` for exponential ones (eqs (16) and (8) in the board's units).

    Raises
    ------
    InputError
        R or lam would not be a finite positive number.
    """
    design = scene.design
    slope = design.exponential_slope or 1.0
    scale = design.gain * design.unit_conductance**2
    product = 1.0 / scale if scale else np.inf
    if design.amplifier != "linear":
        product *= 2.0 * slope / design.unit_voltage
    if isinstance(design.lam, str):
        text = "expected a number; taction.verification.reference.lambda_rule finds it by a rule"
        raise InputError(scene.file, Complaint("design.lambda", repr(design.lam), text))
    given = design.lam or design.resistance or DEFAULT_RESISTANCE
    other = product / given
    resistance, lam = (other, given) if design.lam is not None else (given, other)
    if not (LEAST <= resistance <= MOST and SMALL <= lam <= LARGE):
        text = (
            f"gain and unit_conductance give lambda times R = {product!r}, so R = {resistance:g}"
            f" ohm and lambda = {lam:g}: out of range; expected R between {LEAST:g} and {MOST:g}"
            f" ohm, lambda between {SMALL:g} and {LARGE:g}"
        )
        raise InputError(scene.file, Complaint("design", repr(given), text))
    return Scalings(
        unit_conductance=design.unit_conductance,
        unit_voltage=design.unit_voltage,
        exponential_slope=slope,
        resistance=resistance,
        capacitance=float(nearest(np.array([design.capacitance]), design.capacitor_series)[0]),
        gain=design.gain,
        lam=lam,
    )


def preferred(ohms: float, scene: Scene) -> float:
    """Return `ohms` in the scene's resistor series."""
    return float(nearest(np.array([ohms]), scene.design.resistor_series)[0])


def choose_opamp(scene: Scene) -> OpAmp:
    """Return the op-amp of `scene`: a preset with the scene's changed figures.

    Offset, input currents and common-mode error are in its macromodel if the scene asks for them:
    all with ``input_errors``, else those that the scene gives.

    Raises
    ------
    InputError
        The changed figures contradict each other, or the op-amp does not work at the supply.
    """
    choice, supply = scene.design.opamp, scene.design.supply
    if choice.file is not None:
        return imported_opamp(scene, choice.file)
    opamp = load_presets()[choice.base]
    figures = {name: value for name, value in choice if name in FIGURES and value is not None}
    try:
        opamp = derive(opamp, f"{opamp.name}_changed", **figures) if figures else opamp
        opamp = _with_errors(opamp, choice.input_errors, figures)
    except ValueError as error:
        raise InputError(scene.file, Complaint("design.opamp", repr(figures), str(error))) from None
    if not opamp.least_supply <= supply <= opamp.most_supply:
        text = (
            f"{choice.base} works at supplies from ±{opamp.least_supply:g} V"
            f" to ±{opamp.most_supply:g} V"
        )
        raise InputError(scene.file, Complaint("design.supply", f"±{supply:g} V", text))
    if not opamp.swing(supply) > 0.0:
        found, text = f"{opamp.saturation:g} V", f"must be below the supply of ±{supply:g} V"
        raise InputError(scene.file, Complaint("design.opamp.saturation", found, text))
    return opamp


def _with_errors(opamp: OpAmp, every: bool, given: Mapping[str, float]) -> OpAmp:
    """Return the op-amp with `every` input error of its figures, or with those that are `given`."""
    if not every and not INPUT_ERRORS.keys() & given.keys():
        return opamp
    kept = {name: every or name in given for name in INPUT_ERRORS}
    absent: dict[str, Any] = {name: INPUT_ERRORS[name] for name in kept if not kept[name]}
    return replace(opamp, input_errors=True, **absent)
