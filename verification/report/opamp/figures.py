"""The figures of an op-amp: stated, measured on test benches, and where they come from."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape

from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.system.quantities import show
from taction.verification.characterise.characterise import Measured, supply_of
from taction.verification.report.tables import make_table

TITLES = {
    "dc_gain": ("DC gain", ""),
    "unity_gain_bandwidth": ("unity-gain bandwidth", "Hz"),
    "phase_margin": ("phase margin", "degrees"),
    "input_resistance": ("input resistance", "ohm"),
    "differential_capacitance": ("differential input capacitance", "F"),
    "input_capacitance": ("input capacitance", "F"),
    "output_resistance": ("output resistance", "ohm"),
    "slew_rate": ("slew rate", "V/s"),
    "saturation": ("supply less largest output voltage", "V"),
    "output_current": ("largest output current", "A"),
    "least_supply": ("supply, at least \N{PLUS-MINUS SIGN}", "V"),
    "most_supply": ("supply, at most \N{PLUS-MINUS SIGN}", "V"),
    "offset_voltage": ("offset voltage", "V"),
    "bias_current": ("input bias current", "A"),
    "offset_current": ("input offset current", "A"),
    "common_mode_rejection": ("common-mode rejection", "dB"),
    "voltage_noise": ("voltage noise", "V/rtHz"),
    "current_noise": ("current noise", "A/rtHz"),
    "supply_current": ("supply current", "A"),
    "channels_per_package": ("op-amps in a package", ""),
}
"""Title and unit of every figure of the data file."""
SWING = "swing"
ABSENT = (0.0, math.inf, -math.inf)  # values of a figure that a part does not have
Results = Mapping[str, tuple[Measured, ...]]  # by the name of the witness


def stated_figures(opamp: OpAmp) -> dict[str, float]:
    """Return the figures that the part has, by the keys of `TITLES`."""
    own = {
        "unity_gain_bandwidth": unity_gain_bandwidth(opamp),
        "phase_margin": phase_margin(opamp) if math.isfinite(opamp.gbw) else math.inf,
    }
    values = {name: own.get(name, getattr(opamp, name, math.inf)) for name in TITLES}
    return {name: value for name, value in values.items() if value not in ABSENT}


def figures_document(opamp: OpAmp, notes: Mapping[str, str], results: Results) -> dict[str, Any]:
    """Return everything as plain data for JSON, SI base units."""
    measured: dict[str, dict[str, Any]] = {}
    for witness, found in results.items():
        for figure in found:
            entry = measured.setdefault(figure.name, {"unit": figure.unit, "stated": figure.stated})
            entry[witness] = figure.value
    return {
        "name": opamp.name,
        "source": opamp.source,
        "external_part": opamp.external_part,
        "figures": {
            name: {"value": value, "unit": TITLES[name][1], "note": notes.get(name, "")}
            for name, value in stated_figures(opamp).items()
        },
        "supply": supply_of(opamp),
        "measured": measured,
    }


def print_figures(
    opamp: OpAmp, notes: Mapping[str, str], results: Results, console: Console
) -> None:
    """Print the table of figures, and the source."""
    titles = ("", "data sheet", *results, "note")
    console.print(make_table(titles, _rows(opamp, notes, results), title=opamp.name))
    console.print(f"source: {escape(opamp.source)}")
    if opamp.external_part:
        console.print(f"every op-amp needs a {escape(opamp.external_part)}")
    benches = f"measured at \N{PLUS-MINUS SIGN}{supply_of(opamp):g} V on test benches"
    console.print(
        f"{benches}: the macromodel does what the data sheet says, as far as it is modelled"
    )


def _rows(opamp: OpAmp, notes: Mapping[str, str], results: Results) -> Iterator[tuple[str, ...]]:
    measured = [{f.name: f for f in found} for found in results.values()]
    figures = stated_figures(opamp)
    if "saturation" in figures:
        swing = ("swing", "V")
    for name, value in figures.items():
        title, unit = TITLES[name]
        cells = [_shown(x[name].value, unit) if name in x else "" for x in measured]
        yield (title, _shown(value, unit), *cells, escape(notes.get(name, "")))
        if name == "saturation":
            title, unit = swing
            supply = supply_of(opamp)
            cells = [_shown(x[SWING].value, unit) if SWING in x else "" for x in measured]
            note = f"at \N{PLUS-MINUS SIGN}{supply:g} V"
            yield (f"output {title}", _shown(opamp.swing(supply), unit), *cells, note)


def _shown(value: float, unit: str) -> str:
    if unit in ("degrees", "dB"):
        return f"{value:.4g} {unit}"
    return show(value, unit)
