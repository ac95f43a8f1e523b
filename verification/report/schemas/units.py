"""The unit of every field of the documents: one name has one unit in all of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from taction.system.reading_definitions import READINGS

_FIELDS = {
    "s": "alternatives amplifier_rise_time estimated_seconds max_step mean_step"
    " ngspice_settling_time period seconds seconds_fastest seconds_slowest"
    " settling_time_ideal stage_rise_time stop time time_limit timing"
    " whole_stop",
    "dB": "common_mode_rejection",
    "V": "equilibrium final noise noise_rms offset_voltage reference rms step_amplitude"
    " step_amplitude_uncertainty unit_voltage v voltage",
    "step": "achieved attained_error end_error overshoot_limit record_end"
    " stage_overshoot steady_state steady_state_error wanted wanted_error",
    "1/s": "growth_rate growth_rate_uncertainty rightmost_pole rightmost_pole_uncertainty",
    "Hz": "frequency gbw second_pole",
    "ohm": "gain input_resistance matrix_resistors output_resistance resistance",
    "S": "unit_conductance",
    "F": "capacitance differential_capacitance input_capacitance",
    "A": "bias_current offset_current output_current supply_current",
    "V/s": "slew_rate",
    "V/rtHz": "voltage_noise",
    "A/rtHz": "current_noise",
}
# Fields whose unit another field of the same part gives, by the name `unit`, have none here.
UNIT_OF: dict[str, str] = {name: kind.unit for name, kind in READINGS.items()}
UNIT_OF |= {name: unit for unit, names in _FIELDS.items() for name in names.split()}
_BY_PLACE = {  # a name that means another thing inside this field
    "steady_state": {"equilibrium": "step"},
    "power": dict.fromkeys(("quiescent", "outputs", "resistors", "total"), "W"),
}


def units_in(document: object) -> dict[str, str]:
    """Return the units of the fields that a document has, by name; by path where a name has two.

    Examples
    --------
    >>> units_in({"seconds": 1.0, "steady_state": {"equilibrium": 1e-5}, "scene": "a"})
    {'seconds': 's', 'steady_state': 'step', 'steady_state.equilibrium': 'step'}
    """
    return dict(sorted(set(_units(document, ""))))


def _units(value: object, inside: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for name, item in value.items():
            special = _BY_PLACE.get(inside, {}).get(name)
            if special is not None:
                yield f"{inside}.{name}", special
            elif name in UNIT_OF and not isinstance(item, str) and not _has_unit(item):
                yield name, UNIT_OF[name]
            yield from _units(item, name)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _units(item, inside)


def _has_unit(item: Any) -> bool:
    """Whether a field is a part with other fields, which have units of their own."""
    return isinstance(item, Mapping) and not all(
        isinstance(number, int | float) for number in item.values()
    )
