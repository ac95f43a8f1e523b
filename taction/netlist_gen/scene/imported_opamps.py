"""The file of an imported op-amp: JSON that `taction parts import` writes and scenes name."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from taction.netlist_gen.deck.foreign_deck import stored_subcircuit
from taction.spice_models.branches import check_parts
from taction.spice_models.imported import Figures, ImportedOpAmp, LinearModel, check_pins
from taction.system.documents import plain, read, taken
from taction.system.errors import InputError

FORMAT = 3
OLDER = "a file of an older version; import the netlist again"
LEAST, MOST = 1e-30, 1e30  # SI base units: beyond is no op-amp, and no arithmetic
FIGURES_LEAST = {
    "dc_gain": LEAST, "unity_gain_bandwidth": LEAST, "output_resistance": 0.0,
    "supply_current": 0.0, "slew_rate": LEAST, "swing": 0.0,
}  # fmt: skip
"""The least value of a figure that is not negative."""


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
    if known in (1, 2):
        raise ValueError(f"taction_opamp = {known}: {OLDER}")
    stored = read(StoredOpAmp, data)
    if stored.taction_opamp != FORMAT:
        raise ValueError(f"taction_opamp = {stored.taction_opamp}: expected {FORMAT}")
    if not (stored.name.isidentifier() and stored.name.isascii()):
        raise ValueError(f"name = {stored.name!r}: expected letters, digits and '_'")
    _check_range("supply", stored.supply, least=LEAST)
    _check_range("compensation", stored.compensation, least=0.0)
    for field in fields(Figures):
        value = getattr(stored.figures, field.name)
        if value is not None:
            _check_range(f"figures.{field.name}", value, FIGURES_LEAST.get(field.name))
    if stored.linear is not None:
        _check_linear(stored.linear)
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


def _check_linear(linear: LinearModel) -> None:
    _check_range("linear.error", linear.error, 0.0)
    for part in linear.parts:
        _check_range(f"linear.parts.{part.card}", part.value)
    check_parts(linear.parts)
    low, high = linear.band
    if not LEAST <= low < high <= MOST:
        raise ValueError(f"linear.band = {low!r}, {high!r}: expected two rising frequencies, Hz")
