"""One op-amp: its figures with their sources, and its open loop as stated."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.spice_models.presets import Origin
from taction.system.charts import BLUE, Axis, Chart, Curve, Limit, Mark, Text
from taction.system.foreign_text import visible
from taction.system.quantities import show
from taction.verification.characterise.characterise import Bode, OpAmpFigures, open_loop
from taction.verification.report.blocks import DRAWN, EVERYWHERE, Cell, Notes, Page, Section, Table
from taction.verification.report.texts import quantity
from taction.verification.studies.vendor_model import ImportedModel

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
    "least_supply": ("supply, at least ±", "V"),
    "most_supply": ("supply, at most ±", "V"),
    "offset_voltage": ("offset voltage", "V"),
    "bias_current": ("input bias current", "A"),
    "offset_current": ("input offset current", "A"),
    "common_mode_rejection": ("common-mode rejection", "dB"),
    "offset_drift": ("drift of the offset voltage", "V/K"),
    "bias_drift": ("drift of the bias current", "A/K"),
    "bias_doubling": ("warming that doubles the input currents", "K"),
    "supply_rejection": ("supply rejection", "dB"),
    "voltage_noise": ("voltage noise", "V/rtHz"),
    "voltage_noise_corner": ("corner of its 1/f noise", "Hz"),
    "current_noise": ("current noise", "A/rtHz"),
    "supply_current": ("supply current", "A"),
    "channels_per_package": ("op-amps in a package", ""),
}
"""Title and unit of every figure of the data file."""
ABSENT = (0.0, math.inf, -math.inf, None)  # values of a figure that a part does not have
Origins = Mapping[str, Origin]  # by the name of the figure
WORDS = ("derived", "assumed")  # in the place of a document
AT_LEAST = ("common_mode_rejection", "supply_rejection", "dc_gain")  # guaranteed minima
LISTED = {
    "GBW": ("gbw", "Hz"), "slew rate": ("slew_rate", "V/s"), "offset": ("offset_voltage", "V"),
    "bias": ("bias_current", "A"), "noise": ("voltage_noise", "V/rtHz"),
}  # fmt: skip
"""Figures of the list of op-amps, beside the range of the supply; `view` has all."""
IMPORTED = (
    ("dc_gain", ""), ("unity_gain_bandwidth", "Hz"), ("phase_margin", "degrees"),
    ("output_resistance", "ohm"), ("slew_rate", "V/s"), ("swing", "V"), ("supply_current", "A"),
    ("offset_voltage", "V"), ("bias_current", "A"), ("offset_current", "A"),
    ("common_mode_rejection", "dB"), ("differential_resistance", "ohm"),
    ("common_resistance", "ohm"), ("differential_capacitance", "F"), ("common_capacitance", "F"),
)  # fmt: skip
"""Figures of an imported op-amp, and their units."""


def view(result: OpAmpFigures) -> Page:
    """Return the page of an op-amp."""
    opamp, origins = result.opamp, result.origins
    documents = list(_documents(opamp, origins))
    titles = ("figure", "typical", "guaranteed", "from", "note")
    table = Table("Figures", titles, tuple(_rows(opamp, origins, documents)))
    sources = [f"source: {opamp.source}"]
    sources += [f"[{number}] {title}" for number, title in enumerate(documents, 1)]
    if documents:
        text = "assumed: in no public text of a sheet that was found; derived: see the note"
        sources.append(text)
    if opamp.external_part:
        sources.append(f"every op-amp needs a {opamp.external_part}")
    return Page(
        title=opamp.name,
        command="taction parts show",
        sections=(
            Section("Figures", (table, Notes("", tuple(sources))), "", EVERYWHERE),
            Section("Open loop", lambda: _bode(open_loop(opamp)), media=DRAWN),
        ),
    )


def stated_figures(opamp: OpAmp) -> dict[str, float]:
    """Return the figures that the part has, by the keys of `TITLES`."""
    own = {
        "unity_gain_bandwidth": unity_gain_bandwidth(opamp),
        "phase_margin": phase_margin(opamp) if math.isfinite(opamp.gbw) else math.inf,
    }
    values = {name: own.get(name, getattr(opamp, name, math.inf)) for name in TITLES}
    return {name: value for name, value in values.items() if value not in ABSENT}


def _documents(opamp: OpAmp, origins: Origins) -> dict[str, None]:
    """Return the documents that the shown figures name, in the order of the figures."""
    shown = [origins[name] for name in stated_figures(opamp) if name in origins]
    named = (title for origin in shown for title in (origin.document, origin.limit))
    return dict.fromkeys(title for title in named if title and title not in WORDS)


def _rows(opamp: OpAmp, origins: Origins, documents: list[str]) -> Iterator[tuple[Cell, ...]]:
    limits, nothing = dict(opamp.guaranteed), Cell("")
    numbers = {title: f"[{number}]" for number, title in enumerate(documents, 1)}
    for name, value in stated_figures(opamp).items():
        title, unit = TITLES[name]
        origin = origins.get(name, Origin("", "", ""))
        limit = _cell(limits.get(name), unit)
        if limit.text:
            limit = Cell(f"{'≥' if name in AT_LEAST else '≤'} {limit.text}", limit.number)
        named = filter(None, dict.fromkeys((origin.document, origin.limit)))
        source = Cell(" ".join(numbers.get(each, each) for each in named))
        yield Cell(title), _cell(value, unit), limit, source, Cell(origin.note)
        if name == "saturation":
            supply = min(15.0, opamp.most_supply)
            swing, note = _cell(opamp.swing(supply), "V"), Cell(f"at ±{supply:g} V")
            yield Cell("output swing"), swing, nothing, nothing, note


def _cell(value: float | None, unit: str) -> Cell:
    if value is None:
        return Cell("")
    known = unit in ("degrees", "dB")
    return Cell(f"{value:.4g} {unit}" if known else quantity(value, unit), value)


def _bode(found: Bode) -> tuple[Chart, Chart]:
    frequency, response = Axis("frequency", "Hz", "log"), found.response
    decibels, phase = 20.0 * np.log10(np.abs(response)), np.degrees(np.unwrap(np.angle(response)))
    gain: tuple[Mark, ...] = (Curve(found.frequency, decibels, "", BLUE),)
    angle: tuple[Mark, ...] = (Curve(found.frequency, phase, "", BLUE),)
    said = turned = ""
    if abs(response[-1]) < 1.0:
        crossing, margin = found.crossing()
        said, turned = f"unity gain at {quantity(crossing, 'Hz', 3)}", f"{margin:.3g} degrees"
        gain += _crossing(crossing, 0.0, said)
        angle += _crossing(crossing, margin - 180.0, f"phase margin {turned}")
    title, text = "Bode diagram of the open loop", "Gain of the open loop over the frequency."
    ticks = tuple(range(-180, 1, 45))
    degrees = Axis("phase (degrees)", limits=(-190.0, 10.0), ticks=ticks)
    below = "Phase of the open loop over the frequency."
    return (
        Chart(title, frequency, Axis("gain (dB)"), gain, said, text),
        Chart("Phase of the open loop", frequency, degrees, angle, "", below),
    )


def _crossing(frequency: float, level: float, text: str) -> tuple[Mark, ...]:
    place = np.array([frequency]), np.array([level])
    return (
        Limit(frequency, "x", "", "muted"),
        Curve(*place, text, "muted", "", "square", size=5.0, label=""),
        Text(text, frequency, level, ("left", "below")),
    )


def list_view(models: Mapping[str, OpAmp]) -> Page:
    """Return the page of all presets, with the figures that most boards depend on."""

    def shown(entry: tuple[str, OpAmp], figure: str, unit: str) -> str:
        value = getattr(entry[1], figure)
        return show(value, unit, 3) if value and math.isfinite(value) else "-"

    def supply(model: OpAmp) -> str:
        ends = f"±{model.least_supply:g} to {model.most_supply:g} V"
        return ends if math.isfinite(model.most_supply) else "-"

    columns: dict[str, Callable[[Any], Any]] = {"": lambda each: each[0]}
    for title, (figure, unit) in LISTED.items():
        columns[title] = partial(shown, figure=figure, unit=unit)
    columns["supply"] = lambda each: supply(each[1])
    return Page(
        title="op-amps",
        command="taction parts",
        sections=(Section("Op-amps", (Table.of("", models.items(), columns),), "", EVERYWHERE),),
        foot=("all figures with their sources: taction parts show NAME",),
    )


def imported_view(result: ImportedModel) -> Page:
    """Return the page of an imported model: what was measured, and how a scene uses it."""
    model, lines = result.model, []
    for key, unit in IMPORTED:
        value = model["figures"][key]
        text = "none found" if value is None else show(value, unit)
        lines.append(f"  {key.replace('_', ' '):22} {text}")
    lines += [f"warning: {doubt}" for doubt in model["doubts"]]
    linear = model["linear"]
    if linear is not None:
        text = f"linear at rest: {len(linear['parts'])} parts, within {100 * linear['error']:.2g} %"
        lines.append(f"{text} of ngspice's small signal up to {show(linear['band'][1], 'Hz', 3)}")
    else:
        lines.append(f"{model['missing']}: boards with it stay inconclusive")
    lines.append(f'in a scene beside it: opamp = {{ file = "{visible(result.file)}" }}')
    return Page(
        title=f"{model['name']}, simulated at ±{show(model['supply'], 'V')}",
        command="taction parts import",
        sections=(Section("Figures", (Notes("", tuple(lines)),), media=EVERYWHERE),),
    )
