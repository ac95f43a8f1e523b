"""The op-amp of a scene: a preset with changed figures, or the file of an imported one."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from taction.netlist_gen.scene.imported_opamps import from_document
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.imported import ImportedOpAmp
from taction.spice_models.input_errors import CHANGES, changes, with_input_errors
from taction.spice_models.input_errors import NONE as INPUT_ERRORS
from taction.spice_models.opamp import OpAmp, poles_from_phase_margin
from taction.spice_models.presets import FIGURES, derive
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded

ACCEPTED = "a file that `taction parts import` writes"


def choose_opamp(scene: Scene) -> OpAmp:
    """Return the op-amp of `scene`: a preset with changed figures, or an imported one."""
    choice, supply = scene.design.opamp, scene.design.supply
    if choice.file is not None:
        return imported_opamp(scene, choice.file)
    opamp = OPAMPS[choice.base]
    figures = {name: value for name, value in choice if name in FIGURES and value is not None}
    try:
        opamp = derive(opamp, f"{opamp.name}_changed", **figures) if figures else opamp
        given = {n: v for n, v in figures.items() if n in INPUT_ERRORS or n in CHANGES}
        around = scene.design.surroundings
        opamp = with_input_errors(opamp, choice.input_errors, given, around)
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


def imported_opamp(scene: Scene, file: str) -> OpAmp:
    """Return the op-amp of a file beside the scene, its netlist checked again, or refuse it."""
    path = scene.folder / file
    try:
        name, imported = from_document(json.loads(read_bounded(path, MEGABYTE)))
        opamp = as_opamp(name, imported)
    except (UnusableFileError, ValueError, RecursionError) as error:
        text = f"{str(error) or 'nested too deeply'}; expected {ACCEPTED}"
        raise InputError(scene.file, Complaint("design.opamp.file", repr(file), text)) from None
    if abs(scene.design.supply - imported.supply) > 1e-9 * imported.supply:
        found = f"±{scene.design.supply:g} V"
        text = f"{file} was measured at ±{imported.supply:g} V; import it again with --supply"
        raise InputError(scene.file, Complaint("design.supply", found, text))
    if scene.design.opamp.model == "figures":
        opamp = replace(opamp, imported=None)
    elif scene.analysis.initial != "rest":
        text = "a vendor's model starts at its operating point; expected 'rest'"
        raise InputError(scene.file, Complaint("analysis.initial", "'zero'", text))
    lacking = changes(opamp, {}, "typical", {}, scene.design.surroundings)[1]
    return replace(opamp, not_known=tuple(lacking))


def as_opamp(name: str, imported: ImportedOpAmp) -> OpAmp:
    """Return the op-amp with the measured figures; a second pole where the phase margin has one."""
    figures = imported.figures
    try:
        gbw, second_pole = poles_from_phase_margin(
            figures.dc_gain, figures.unity_gain_bandwidth, figures.phase_margin
        )
    except ValueError:
        gbw, second_pole = figures.unity_gain_bandwidth, float("inf")
    measured: dict[str, Any] = {
        name: getattr(figures, name)
        for name in ("slew_rate", *INPUT_ERRORS)
        if getattr(figures, name) is not None
    }
    if figures.swing is not None:
        measured["saturation"] = imported.supply - figures.swing
    return OpAmp(
        name=name,
        dc_gain=figures.dc_gain,
        gbw=gbw,
        second_pole=second_pole,
        input_resistance=figures.differential_resistance or float("inf"),
        differential_capacitance=figures.differential_capacitance or 0.0,
        input_capacitance=figures.common_capacitance or 0.0,
        output_resistance=figures.output_resistance,
        supply_current=figures.supply_current,
        source=f"imported from a netlist, measured at {imported.supplies}",
        imported=imported,
        **measured,
    )
