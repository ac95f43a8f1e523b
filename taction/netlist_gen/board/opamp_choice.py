"""The op-amp of a scene: a preset with changed figures, or an imported one and its file.

The file is JSON that `taction parts import` writes and scenes name.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.branches import check_parts
from taction.spice_models.imported import Figures, ImportedOpAmp, LinearModel, check_pins
from taction.spice_models.input_errors import CHANGES, changes, with_input_errors
from taction.spice_models.input_errors import NONE as INPUT_ERRORS
from taction.spice_models.opamp import OpAmp, poles_from_phase_margin
from taction.spice_models.presets import FIGURES, Origin, derive
from taction.system.documents import plain, read, taken
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded
from taction.system.results import Result

FORMAT = 3
LEAST, MOST = 1e-30, 1e30  # SI base units: beyond is no op-amp, and no arithmetic
FIGURES_LEAST = {  # the least value of a figure that is not negative
    "dc_gain": LEAST, "unity_gain_bandwidth": LEAST, "output_resistance": 0.0,
    "supply_current": 0.0, "slew_rate": LEAST, "swing": 0.0,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class OpAmpFigures(Result):
    """An op-amp with its figures, and where they come from; empty of another package."""

    VIEW = "taction.verification.report.views.opamp_view:view"
    DOCUMENT = "taction.verification.report.documents.plain:ShowDocument.of"

    opamp: OpAmp = field(repr=False)
    origins: Mapping[str, Origin] = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredOpAmp:
    """The file of an imported op-amp."""

    taction_opamp: int
    name: str
    subcircuit: str
    netlist: tuple[str, ...]
    pins: tuple[str, ...]
    supply: float
    compensation: float = 0.0
    figures: Figures
    linear: LinearModel | None
    missing: str
    doubts: tuple[str, ...] = ()


def to_document(name: str, opamp: ImportedOpAmp) -> dict[str, Any]:
    """Return an imported op-amp as JSON data."""
    cards = {"subcircuit": opamp.subcircuit.name, "netlist": opamp.subcircuit.lines}
    made: dict[str, Any] = plain(
        taken(StoredOpAmp, opamp, taction_opamp=FORMAT, name=name, **cards)
    )
    return made


def from_document(data: Any) -> tuple[str, ImportedOpAmp]:
    """Return the name and the op-amp of JSON data, or raise ValueError; its netlist is checked."""
    known = data.get("taction_opamp") if isinstance(data, dict) else FORMAT
    if known != FORMAT:
        raise ValueError(f"taction_opamp = {known!r}: expected {FORMAT}; import the netlist again")
    stored = read(StoredOpAmp, data)
    if not (stored.name.isidentifier() and stored.name.isascii()):
        raise ValueError(f"name = {stored.name!r}: expected letters, digits and '_'")
    _check_range("supply", stored.supply, least=LEAST)
    _check_range("compensation", stored.compensation, least=0.0)
    for each in fields(Figures):
        value = getattr(stored.figures, each.name)
        if value is not None:
            _check_range(f"figures.{each.name}", value, FIGURES_LEAST.get(each.name))
    if stored.linear is not None:
        _check_range("linear.error", stored.linear.error, 0.0)
        for part in stored.linear.parts:
            _check_range(f"linear.parts.{part.card}", part.value)
        check_parts(stored.linear.parts)
        low, high = stored.linear.band
        if not LEAST <= low < high <= MOST:
            raise ValueError(
                f"linear.band = {low!r}, {high!r}: expected two rising frequencies, Hz"
            )
    from taction.netlist_gen.deck.foreign_deck import stored_subcircuit  # most boards have none

    try:
        subcircuit = stored_subcircuit(stored.netlist, stored.subcircuit, stored.name)
    except InputError as error:
        raise ValueError(str(error)) from None
    try:
        check_pins(stored.pins, subcircuit.ports)
    except ValueError as error:
        raise ValueError(f"pins: {error}") from None
    made = taken(ImportedOpAmp, stored, subcircuit=subcircuit)
    return stored.name, made


def _check_range(key: str, value: float, least: float | None = None) -> None:
    """Refuse a number that no op-amp has; with `least` also a smaller or a negative one."""
    if abs(value) > MOST or (least is not None and value < least):
        low = -MOST if least is None else least
        raise ValueError(f"{key} = {value!r}: expected a number from {low:g} to {MOST:g}")


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
        source=f"imported from a netlist, measured at ±{imported.supply:g} V",
        imported=imported,
        **measured,
    )
