"""The file of an imported op-amp: JSON that `taction parts import` writes and scenes name."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from taction.spice_models.foreign_lines import RefusedError
from taction.spice_models.foreign_netlist import read_subcircuit
from taction.spice_models.imported import (
    Figures,
    ImportedOpAmp,
    LinearModel,
    Rational,
    check_pins,
)
from taction.system.documents import plain, read, taken
from taction.system.errors import listed

FORMAT = 2
READ = (1, FORMAT)
LEAST, MOST = 1e-30, 1e30  # SI base units: beyond is no op-amp, and no arithmetic
FIGURES_LEAST = {
    "dc_gain": LEAST, "unity_gain_bandwidth": LEAST, "output_resistance": 0.0,
    "supply_current": 0.0, "slew_rate": LEAST, "swing": 0.0,
}  # fmt: skip
"""The least value of a figure that is not negative."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredOpAmp:
    """The file of an imported op-amp; a file of version 1 has neither compensation nor doubts."""

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
    """Return the name and the op-amp of JSON data; the netlist is checked again.

    Raises
    ------
    ValueError
        The data is no imported op-amp; the text says where, and what is expected.
    """
    stored = read(StoredOpAmp, data)
    if stored.taction_opamp not in READ:
        raise ValueError(f"taction_opamp = {stored.taction_opamp}: expected one of {listed(READ)}")
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
        content = "\n".join(stored.netlist).encode()
        subcircuit = read_subcircuit(content, stored.subcircuit, stored.name)
    except RefusedError as error:
        raise ValueError(f"netlist: {error}") from None
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
    for key in ("conductance", "capacitance", "error"):
        _check_range(f"linear.{key}", getattr(linear, key), 0.0)
    for key in ("offset", "rest", "bias_current"):
        _check_range(f"linear.{key}", getattr(linear, key))
    for key in ("gain", "impedance"):
        rational: Rational = getattr(linear, key)
        place = f"linear.{key}"
        if len(rational.poles) != len(rational.residues):
            raise ValueError(f"{place}: expected as many residues as poles")
        _check_range(f"{place}.constant", rational.constant)
        for pole, residue in zip(rational.poles, rational.residues, strict=True):
            _check_range(f"{place}.residues", abs(residue))
            _check_range(f"{place}.poles", abs(pole), LEAST)
            if pole.real >= 0.0:
                raise ValueError(f"{place}.poles = {pole}: expected a negative real part")
    if linear.gain.poles != linear.impedance.poles:
        raise ValueError("linear: gain and impedance must have the same poles")
    low, high = linear.band
    if not LEAST <= low < high <= MOST:
        raise ValueError(f"linear.band = {low!r}, {high!r}: expected two rising frequencies, Hz")
