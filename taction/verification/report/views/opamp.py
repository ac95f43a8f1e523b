"""One op-amp: its figures beside what its macromodel does, the open loop, steps of a follower."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.spice_models.presets import Origin
from taction.system.array_types import Floats
from taction.system.foreign_text import visible
from taction.system.quantities import show
from taction.verification.characterise.characterise import (
    STEP,
    Bode,
    Measured,
    OpAmpFigures,
    bode,
    large_step,
    step_response,
    supply_of,
)
from taction.verification.characterise.vendor_model import ImportedModel
from taction.verification.characterise.witnesses import Witness
from taction.verification.report.blocks import (
    EVERYWHERE,
    Cell,
    Notes,
    Page,
    Section,
    Sheet,
    Table,
    cell,
)
from taction.verification.report.charts import BLUE, ORANGE, Axis, Chart, Curve, Limit, Mark, Text
from taction.verification.report.texts import quantity, readable

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
SWING = "swing"
ABSENT = (0.0, math.inf, -math.inf)  # values of a figure that a part does not have
MARKS = 25  # of the second witness on a curve
SHOWN_SMALL, SHOWN_LARGE = 0.5, 0.6  # of the records of the steps
SKIPPED = 1e-3  # of the shown record: the jump through the input's capacitance
Results = Mapping[str, tuple[Measured, ...]]  # by the name of the witness
Origins = Mapping[str, Origin]  # by the name of the figure
WORDS = ("derived", "assumed")  # in the place of a document
AT_LEAST = (
    "common_mode_rejection",
    "supply_rejection",
    "dc_gain",
)  # figures with a guaranteed minimum


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What one witness measured: the open loop, and steps as pairs of instants and voltages."""

    bode: Bode
    small: tuple[Floats, Floats]
    large: tuple[Floats, Floats] | None


def measure_curves(opamp: OpAmp, witness: Witness) -> Curves:
    """Measure the curves of the charts."""
    large = large_step(opamp, witness) if math.isfinite(opamp.input_range) else None
    return Curves(bode(opamp, witness), step_response(opamp, witness), large)


def view(result: OpAmpFigures) -> Page:
    """Return the page of an op-amp."""
    opamp, origins, results = result.opamp, result.origins, result.results
    documents = list(_documents(opamp, origins))
    titles = ("figure", "typical", "guaranteed", *results, "from", "note")
    table = Table("Figures", titles, tuple(_rows(opamp, origins, documents, results)))
    benches = f"measured at \N{PLUS-MINUS SIGN}{supply_of(opamp):g} V on test benches"
    sources = [f"source: {opamp.source}"]
    sources += [f"[{number}] {title}" for number, title in enumerate(documents, 1)]
    if documents:
        sources.append(
            "assumed: in no public text of a sheet that was found; derived: see the note"
        )
    if opamp.external_part:
        sources.append(f"every op-amp needs a {opamp.external_part}")
    sources.append(
        f"{benches}: the macromodel does what the data sheet says, as far as it is modelled"
    )

    @cache
    def columns() -> tuple[tuple[Chart, ...], ...]:
        curves = {name: measure_curves(opamp, each) for name, each in result.witnesses.items()}
        return _charts(opamp, curves)

    return Page(
        title=opamp.name,
        command="taction parts show",
        sections=(
            Section("Figures", (table, Notes("", tuple(sources))), "", EVERYWHERE),
            Section("Open loop and follower", lambda: sum(columns(), ())),
        ),
        sheet=lambda: Sheet(
            f"{opamp.name}: open loop and follower",
            columns(),
            (1.25, 1.0),
            tuple((1.0,) * len(column) for column in columns()),
            (11.5, 6.6),
        ),
    )


def stated_figures(opamp: OpAmp) -> dict[str, float]:
    """Return the figures that the part has, by the keys of `TITLES`."""
    own = {
        "unity_gain_bandwidth": unity_gain_bandwidth(opamp),
        "phase_margin": phase_margin(opamp) if math.isfinite(opamp.gbw) else math.inf,
    }
    values = {name: own.get(name, getattr(opamp, name, math.inf)) for name in TITLES}
    return {name: value for name, value in values.items() if value not in (*ABSENT, None)}


def _documents(opamp: OpAmp, origins: Origins) -> dict[str, None]:
    """Return the documents that the shown figures name, in the order of the figures."""
    shown = [origins[name] for name in stated_figures(opamp) if name in origins]
    named = (title for origin in shown for title in (origin.document, origin.limit))
    return dict.fromkeys(title for title in named if title and title not in WORDS)


def _rows(
    opamp: OpAmp, origins: Origins, documents: list[str], results: Results
) -> Iterator[tuple[Cell, ...]]:
    measured = [{f.name: f.value for f in found} for found in results.values()]
    limits, unknown = dict(opamp.guaranteed), Origin("", "", "")

    def reference(document: str) -> str:
        return f"[{documents.index(document) + 1}]" if document in documents else document

    for name, value in stated_figures(opamp).items():
        title, unit = TITLES[name]
        origin = origins.get(name, unknown)
        limit = _cell(limits.get(name), unit)
        if limit.text:
            bound = (
                "\N{GREATER-THAN OR EQUAL TO}" if name in AT_LEAST else "\N{LESS-THAN OR EQUAL TO}"
            )
            limit = Cell(f"{bound} {limit.text}", limit.number)
        named = dict.fromkeys(filter(None, map(reference, (origin.document, origin.limit))))
        cells = (_cell(found.get(name), unit) for found in measured)
        yield (
            Cell(title),
            _cell(value, unit),
            limit,
            *cells,
            Cell(" ".join(named)),
            Cell(origin.note),
        )
        if name == "saturation":
            supply = supply_of(opamp)
            cells = (_cell(found.get(SWING), "V") for found in measured)
            note = Cell(f"at \N{PLUS-MINUS SIGN}{supply:g} V")
            yield (
                Cell("output swing"),
                _cell(opamp.swing(supply), "V"),
                Cell(""),
                *cells,
                Cell(""),
                note,
            )


def _cell(value: float | None, unit: str) -> Cell:
    if value is None:
        return Cell("")
    if unit in ("degrees", "dB"):
        return Cell(f"{value:.4g} {unit}", value)
    return Cell(quantity(value, unit), value)


def _charts(opamp: OpAmp, curves: Mapping[str, Curves]) -> tuple[tuple[Chart, ...], ...]:
    """Return the columns of the picture: the open loop, and the steps of a follower."""
    first = next(iter(curves.values()))
    steps = [_small(curves)]
    if first.large is not None:
        steps.append(_large(opamp, curves))
    return _bode(curves), tuple(steps)


def _curves(
    found: Mapping[str, tuple[Floats, Floats]], even: Floats | None = None
) -> Iterator[Curve]:
    """Yield the first witness as a line and the others as marks, `even` along x where given."""
    for number, (name, (x, y)) in enumerate(found.items()):
        if not number:
            yield Curve(x, y, name, BLUE, width=1.8)
            continue
        places = x[:: max(len(x) // MARKS, 1)] if even is None else even
        values = np.interp(places, x, y)
        yield Curve(places, values, name, ORANGE, "", "circle-open", size=5.0)


def _bode(curves: Mapping[str, Curves]) -> tuple[Chart, Chart]:
    found = {name: each.bode for name, each in curves.items()}
    gains = {
        name: (each.frequency, 20.0 * np.log10(np.abs(each.response)))
        for name, each in found.items()
    }
    phases = {
        name: (each.frequency, np.degrees(np.unwrap(np.angle(each.response))))
        for name, each in found.items()
    }
    first = next(iter(found.values()))
    gain: tuple[Mark, ...] = tuple(_curves(gains))
    phase: tuple[Mark, ...] = tuple(_curves(phases))
    text = ""
    if abs(first.response[-1]) < 1.0:
        crossing, margin = first.crossing()
        text = f"unity gain at {quantity(crossing, 'Hz', 3)}"
        gain += _crossing(crossing, 0.0, text)
        phase += _crossing(crossing, margin - 180.0, f"phase margin {margin:.3g} degrees")
    return (
        Chart(
            "Bode diagram of the open loop",
            Axis("frequency", "Hz", "log"),
            Axis("gain (dB)"),
            gain,
            message=text,
            summary="Gain of the open loop over the frequency.",
        ),
        Chart(
            "Phase of the open loop",
            Axis("frequency", "Hz", "log"),
            Axis("phase (degrees)", limits=(-190.0, 10.0), ticks=tuple(range(-180, 1, 45))),
            phase,
            summary="Phase of the open loop over the frequency.",
            legend="",
        ),
    )


def _crossing(frequency: float, level: float, text: str) -> tuple[Mark, ...]:
    place = np.array([frequency]), np.array([level])
    return (
        Limit(frequency, "x", "", "muted"),
        Curve(*place, text, "muted", "", "square", size=5.0, label=""),
        Text(text, frequency, level, ("left", "below")),
    )


def _step(
    found: Mapping[str, tuple[Floats, Floats]], shown: float
) -> tuple[tuple[Curve, ...], float]:
    """Return the first part of the steps, the share `shown` of the record, and its end in s.

    The first point is left out: the ideal step passes the input's capacitance in no time.
    """
    stop = shown * float(next(iter(found.values()))[0][-1])
    live = {}
    for name, (time, volts) in found.items():
        kept = (time <= stop) & (time > SKIPPED * stop)
        kept[0] = False
        live[name] = time[kept], volts[kept]
    return tuple(_curves(live, np.linspace(0.0, stop, MARKS + 1)[1:])), stop


def _small(curves: Mapping[str, Curves]) -> Chart:
    found = {name: each.small for name, each in curves.items()}
    marks, stop = _step(found, SHOWN_SMALL)
    response = next(iter(found.values()))[1][1:]
    low, high = float(response.min()), float(response.max())
    return Chart(
        "Small step",
        Axis("time", "s", limits=(0.0, stop)),
        Axis("output over step", limits=(min(0.0, low) - 0.05, max(1.0, high) + 0.05)),
        (Limit(1.0, "y", "", "muted"), *marks),
        message=f"{100.0 * max(high - 1.0, 0.0):.2g} % overshoot",
        summary="A step that is too small for the limits of the op-amp.",
        legend="",
    )


def _large(opamp: OpAmp, curves: Mapping[str, Curves]) -> Chart:
    found = {name: each.large for name, each in curves.items() if each.large is not None}
    marks, stop = _step(found, SHOWN_LARGE)
    final = STEP * opamp.swing(supply_of(opamp))
    return Chart(
        "Large step",
        Axis("time", "s", limits=(0.0, stop)),
        Axis("output", "V"),
        (Limit(final, "y", "", "muted"), *marks),
        message=readable(f"{quantity(opamp.slew_rate, 'V/s', 3)} at most"),
        summary="A step at which the slew rate limits the output.",
        legend="",
    )


def list_view(models: Mapping[str, OpAmp]) -> Page:
    """Return the page of all presets, with the figures that most boards depend on."""
    rows = []
    for name, model in models.items():
        values = [(getattr(model, figure), unit) for figure, unit, _ in LISTED]
        known = [show(x, unit, 3) if x and math.isfinite(x) else "-" for x, unit in values]
        ends = f"\N{PLUS-MINUS SIGN}{model.least_supply:g} to {model.most_supply:g} V"
        rows.append((name, *known, ends if math.isfinite(model.most_supply) else "-"))
    titles = ("", *(title for _, _, title in LISTED), "supply")
    table = Table("", titles, tuple(tuple(map(cell, row)) for row in rows))
    more = "all figures with their sources, and what the model does: taction parts show NAME"
    return Page(
        title="op-amps",
        command="taction parts",
        sections=(Section("Op-amps", (table,), media=EVERYWHERE),),
        foot=(more,),
    )


LISTED = (
    ("gbw", "Hz", "GBW"),
    ("slew_rate", "V/s", "slew rate"),
    ("offset_voltage", "V", "offset"),
    ("bias_current", "A", "bias"),
    ("voltage_noise", "V/rtHz", "noise"),
)
"""Figures of the list of op-amps, beside the range of the supply; `view` has all."""


def imported_view(result: ImportedModel) -> Page:
    """Return the page of an imported model: what was measured, and how a scene uses it."""
    model = result.model
    lines = []
    for key, unit in IMPORTED:
        value = model["figures"][key]
        text = "none found" if value is None else show(value, unit)
        lines.append(f"  {key.replace('_', ' '):22} {text}")
    lines += [f"warning: {doubt}" for doubt in model["doubts"]]
    linear = model["linear"]
    if linear is not None:
        lines.append(
            f"linear at rest: {len(linear['parts'])} parts, within {100.0 * linear['error']:.2g} %"
            f" of ngspice's small signal up to {show(linear['band'][1], 'Hz', 3)}"
        )
    else:
        lines.append(f"{model['missing']}: boards with it stay inconclusive")
    lines.append(f'in a scene beside it: opamp = {{ file = "{visible(result.file)}" }}')
    return Page(
        title=f"{model['name']}, simulated at \N{PLUS-MINUS SIGN}{show(model['supply'], 'V')}",
        command="taction parts import",
        sections=(Section("Figures", (Notes("", tuple(lines)),), media=EVERYWHERE),),
    )


IMPORTED = (
    ("dc_gain", ""), ("unity_gain_bandwidth", "Hz"), ("phase_margin", "degrees"),
    ("output_resistance", "ohm"), ("slew_rate", "V/s"), ("swing", "V"), ("supply_current", "A"),
    ("offset_voltage", "V"), ("bias_current", "A"), ("offset_current", "A"),
    ("common_mode_rejection", "dB"), ("differential_resistance", "ohm"),
    ("common_resistance", "ohm"), ("differential_capacitance", "F"), ("common_capacitance", "F"),
)  # fmt: skip
"""Figures of an imported op-amp, and their units."""
