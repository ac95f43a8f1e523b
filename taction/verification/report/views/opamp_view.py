"""One op-amp with its sources and open loop; the parts of a board, also as CSV for KiCad."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from taction.netlist_gen.board.bill_of_materials import UNITS, BillOfMaterials, PartLine
from taction.netlist_gen.board.opamp_choice import OpAmpFigures
from taction.netlist_gen.kicad.part_symbols import printed_value
from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.spice_models.presets import Origin
from taction.system.charts import BLUE, Axis, Chart, Curve, Limit, Mark, Text
from taction.system.errors import first_ones
from taction.system.foreign_files import visible
from taction.system.quantities import counted, percent, quantity, readable, show
from taction.verification.report.blocks import Content, Page, Section, Table
from taction.verification.report.texts import Cell, fields
from taction.verification.verdict.board_files import BoardPower, PartsList

if TYPE_CHECKING:
    from taction.verification.studies.decks.vendor_model import ImportedModel

TITLES = {  # title and unit of every figure of the data file
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
POINTS = 500  # of a Bode plot
BELOW, ABOVE = 0.01, 100.0  # its ends: of the first pole, and of the unity-gain bandwidth
ABSENT = (0.0, math.inf, -math.inf, None)  # values of a figure that a part does not have
WORDS = ("derived", "assumed")  # in the place of a document
AT_LEAST = ("common_mode_rejection", "supply_rejection", "dc_gain")  # guaranteed minima
LISTED = {  # figures of the list of op-amps, beside the range of the supply; `view` has all
    "GBW": ("gbw", "Hz"), "slew rate": ("slew_rate", "V/s"), "offset": ("offset_voltage", "V"),
    "bias": ("bias_current", "A"), "noise": ("voltage_noise", "V/rtHz"),
}  # fmt: skip


def view(result: OpAmpFigures) -> Page:
    """Return the page of an op-amp."""
    opamp, documents = result.opamp, dict[str, str]()
    titles = ("figure", "typical", "guaranteed", "from", "note")
    table = Table("Figures", titles, tuple(_rows(opamp, result.origins, documents)))
    sources = [f"source: {opamp.source}"]
    sources += (f"{number} {title}" for title, number in documents.items())
    if documents:
        text = "assumed: in no public text of a sheet that was found; derived: see the note"
        sources.append(text)
    if opamp.external_part:
        sources.append(f"every op-amp needs a {opamp.external_part}")
    return Page(
        title=opamp.name,
        command="taction parts show",
        sections=(
            Section("Figures", (table, *sources), "", "terminal page notebook"),
            Section("Open loop", lambda: _bode(opamp), media="page picture"),
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


def _rows(
    opamp: OpAmp, origins: Mapping[str, Origin], documents: dict[str, str]
) -> Iterator[tuple[Cell, ...]]:
    """Yield the figures; `documents` takes the number of each document that they name."""
    limits = dict(opamp.guaranteed)
    for name, value in stated_figures(opamp).items():
        title, unit = TITLES[name]
        origin = origins.get(name, Origin("", "", ""))
        limit = _cell(limits.get(name), unit)
        if limit.text:
            limit = Cell(f"{'≥' if name in AT_LEAST else '≤'} {limit.text}", limit.number)
        named = [*dict.fromkeys(filter(None, (origin.document, origin.limit)))]
        for each in named:
            if each not in WORDS:
                documents.setdefault(each, f"[{len(documents) + 1}]")
        source = Cell(" ".join(documents.get(each, each) for each in named))
        yield Cell(title), _cell(value, unit), limit, source, Cell(origin.note)


def _cell(value: float | None, unit: str) -> Cell:
    if value is None:
        return Cell("")
    known = unit in ("degrees", "dB")
    return Cell(f"{value:.4g} {unit}" if known else quantity(value, unit), value)


def _bode(opamp: OpAmp) -> tuple[Chart, Chart]:
    """Return the open loop as stated, from below the first pole to above unity gain."""
    finite, crossing = math.isfinite(opamp.gbw), unity_gain_bandwidth(opamp)
    low, high = (opamp.first_pole, crossing) if finite else (1.0, 1e6)
    frequency = np.geomspace(BELOW * low, ABOVE * high, POINTS)
    response = np.full(POINTS, complex(opamp.dc_gain))
    for pole in (opamp.first_pole, opamp.second_pole):
        response = response / (1.0 + 1j * frequency / pole)
    hertz, phase = Axis("frequency", "Hz", "log"), np.degrees(np.unwrap(np.angle(response)))
    gain: tuple[Mark, ...] = (Curve(frequency, 20.0 * np.log10(np.abs(response)), "", BLUE),)
    angle: tuple[Mark, ...] = (Curve(frequency, phase, "", BLUE),)
    if finite:
        margin = phase_margin(opamp)
        gain += _crossing(crossing, 0.0, f"unity gain at {quantity(crossing, 'Hz', 3)}")
        angle += _crossing(crossing, margin - 180.0, f"phase margin {margin:.3g} degrees")
    degrees, text = Axis("phase (degrees)", limits=(-190.0, 10.0)), "of the open loop"
    return (
        Chart(f"Bode diagram {text}", hertz, Axis("gain (dB)"), gain, f"Gain {text}."),
        Chart(f"Phase {text}", hertz, degrees, angle, f"Phase {text}."),
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

    def supply(entry: tuple[str, OpAmp]) -> str:
        low, high = entry[1].least_supply, entry[1].most_supply
        return f"±{low:g} to {high:g} V" if math.isfinite(high) else "-"

    columns: dict[str, Callable[[Any], Any]] = {"": lambda each: each[0]}
    for title, (figure, unit) in LISTED.items():
        columns[title] = partial(shown, figure=figure, unit=unit)
    columns["supply"] = supply
    return Page(
        title="op-amps",
        command="taction parts",
        sections=(
            Section("Op-amps", Table.of("", models.items(), columns), "", "terminal page notebook"),
        ),
        foot=("all figures with their sources: taction parts show NAME",),
    )


def imported_view(result: ImportedModel) -> Page:
    """Return the page of an imported model: what was measured, and how a scene uses it."""
    model, facts, lines = result.model, dict[str, str](), list[str]()
    for key, value in model["figures"].items():
        unit = TITLES[key][1] if key in TITLES else "F" if "capacitance" in key else "ohm"
        text = "none found" if value is None else show(value, "V" if key == "swing" else unit)
        facts[key.replace("_", " ")] = text
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
        sections=(Section("Figures", (facts, *lines), media="terminal page notebook"),),
    )


SHOWN = 3  # references in a line of the table
DIGITS = 6  # of a value in a file; the JSON document has all of them
# The fields of KiCad's bill of materials, then our own; a footprint is not known.
COLUMNS = (
    *("Reference", "Value", "Footprint", "Quantity", "DNP"),
    *("Kind", "Unit", "Tolerance", "Preferred", "Series", "Deviation"),
)


def parts_view(result: PartsList) -> Page:
    """Return the page of the parts of a board."""
    table, *lines = parts_content(result.parts, result.power, SHOWN)
    return Page(
        title=result.scene.name,
        command="taction export bom",
        summary=counts_text(result.parts),
        sections=(Section("Parts", table), Section("Board", lines)),
    )


def parts_content(parts: BillOfMaterials, power: BoardPower, shown: int) -> tuple[Content, ...]:
    """Return the parts, `shown` references of each value, then packages, power, what is missing."""
    return (
        Table.of("Parts", parts.lines, part_columns(shown)),
        packages_text(parts),
        f"supply current {quantity(power.supply_current, 'A', 3)}, dissipation"
        f" {quantity(power.total, 'W', 3)} at rest",
        *(f"not included: {readable(what)}" for what in parts.not_listed),
    )


def counts_text(parts: BillOfMaterials) -> str:
    """Return how many parts and values there are, and how many are not standard."""
    counts = " and ".join(f"{parts.count(kind)} {kind}s" for kind in UNITS)
    odd = sum(line.preferred is not None for line in parts.lines)
    remedy = "; set resistor_series and capacitor_series" if odd else ""
    return f"{counts} of {len(parts.lines)} values; not a standard value: {odd}{remedy}"


def packages_text(parts: BillOfMaterials) -> str:
    """Return the packages of op-amps, and the op-amps without use."""
    names = [package.reference for package in parts.packages]
    shown = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    spare = f"; spare op-amps: {parts.spare} in {names[-1]}" if parts.spare else ""
    return f"{counted(len(names), 'package')} {parts.opamp}, {shown}{spare}"


def part_columns(shown: int) -> dict[str, Callable[[Any], Any]]:
    """Return the columns of the parts of one value, of which `shown` have their names."""

    def sold(line: PartLine) -> str:
        if (near := line.preferred) is None:
            return ""
        return f"{near.series}: {quantity(near.value, line.unit)} ({100 * near.deviation:+.2g} %)"

    return {
        **fields("part = kind; value @unit"),
        "count": lambda line: len(line.references),
        "tolerance": lambda line: (
            None if line.tolerance is None else Cell(percent(line.tolerance), line.tolerance)
        ),
        "not a standard value; nearest": sold,
        "references": lambda line: first_ones(line.references, shown, " "),
    }


def parts_csv(parts: BillOfMaterials) -> str:
    """Return the parts as CSV, one row for each value, the op-amps last; values have prefixes."""
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    table.writeheader()

    def write(names: Sequence[str], **record: Any) -> None:
        table.writerow({"Reference": ",".join(names), "Quantity": len(names), **record})

    for line in parts.lines:
        value, near = printed_value(line.value, DIGITS), line.preferred
        more = {} if line.tolerance is None else {"Tolerance": repr(line.tolerance)}
        if near is not None:
            more |= {"Preferred": printed_value(near.value, DIGITS), "Series": near.series}
            more["Deviation"] = f"{near.deviation:.3g}"
        write(line.references, Value=value, Kind=line.kind, Unit=line.unit, **more)
    packages = [package.reference for package in parts.packages]
    write(packages, Value=parts.opamp.upper(), Kind="op-amp")
    return text.getvalue()
