"""The report of an onset: stable ranges, crossings, poles over the value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taction.system.quantities import readable, show
from taction.verification.report.html.blocks import (
    Block,
    Cell,
    Facts,
    Notes,
    Outcome,
    Picture,
    Report,
    Section,
    Table,
)
from taction.verification.report.html.pictures import (
    area,
    axis,
    label,
    line,
    log_axis,
    numbers,
    words,
)
from taction.verification.report.html.sections.origin import origin_section
from taction.verification.report.html.texts import number_cell, quantity
from taction.verification.report.onset.tables import direction
from taction.verification.studies.onset.onset import CheckedEdge, Onset

RINGS = 0.5  # damping ratio up to which a mode is on the pictures
STATES: dict[bool | None, Outcome] = {True: "pass", False: "fail", None: "inconclusive"}
WORDS = {True: "confirmed", False: "contradicted", None: "undecided"}


def onset_report(onset: Onset) -> Report:
    """Return the report of an onset."""
    name, unit, samples = onset.axis.name, onset.axis.key.unit, onset.scan.samples
    ranges = [f"{quantity(a, unit)} to {quantity(b, unit)}" for a, b in onset.scan.stable_ranges]
    stable = "; ".join(ranges) or "nowhere in the examined range"
    examined = f"{quantity(samples[0].value, unit)} to {quantity(samples[-1].value, unit)}"
    return Report(
        title=onset.scene.name,
        command="taction onset",
        outcome="inconclusive" if onset.disagreement else "",
        summary=f"Stable for {name}: {stable}.",
        lines=(f"{name} from {examined}, poles at {len(samples)} values.",),
        sections=(
            Section("Crossings", tuple(_crossings(onset))),
            Section("Poles", tuple(_pictures(onset))),
            origin_section(onset.scene),
        ),
    )


def _crossings(onset: Onset) -> Iterator[Block]:
    unit = onset.axis.key.unit
    if not onset.findings:
        yield Notes("", ("No pole crosses the imaginary axis in this range.",))
    else:
        titles = (
            "crossing",
            "frequency",
            "side",
            "transients",
            "rate below",
            "rate above",
            "remark",
        )
        yield Table("Crossings", titles, tuple(_row(each, unit) for each in onset.findings))
    rows = [
        (
            f"unstable poles at {quantity(count.value, unit)}",
            f"{count.poles} by eigenvalues, "
            + (count.reason if count.winding is None else f"{count.winding} by winding number"),
        )
        for count in onset.counts
    ]
    rows += [
        ("rounding decides", f"{quantity(a, unit)} to {quantity(b, unit)}")
        for a, b in onset.scan.unresolved
    ]
    if rows:
        yield Facts("Two counts of the unstable poles", tuple(rows))
    failures = [sample for sample in onset.scan.samples if sample.failure]
    if failures:
        texts = tuple(f"{quantity(s.value, unit)}: {s.failure}" for s in failures[:10])
        yield Notes(f"No poles at {len(failures)} values", texts)


def _row(finding: CheckedEdge, unit: str) -> tuple[Cell, ...]:
    crossing, trial = finding.crossing, finding.confirmation
    rates = [None if side is None else side.growth_rate for side in (trial.below, trial.above)]
    return (
        Cell(readable(show(crossing.value, unit, 7)), crossing.value),
        number_cell(crossing.frequency, "Hz", 5) if crossing.frequency else Cell("real pole"),
        Cell(direction(crossing)),
        Cell(WORDS[trial.confirmed], None, STATES[trial.confirmed]),
        *(number_cell(rate, "1/s") for rate in rates),
        Cell(trial.reason),
    )


def _pictures(onset: Onset) -> Iterator[Block]:
    rows = [
        (sample.value, p.real, p.imag)
        for sample in onset.scan.samples
        if not sample.failure
        for p in sample.poles[: sample.known or None].tolist()
        if p.imag > 0.0 and -p.real < RINGS * abs(p)
    ]
    value, real, imag = np.array(rows or np.zeros((0, 3))).T
    if not len(value):
        yield Notes("", ("No pole of any value rings.",))
        return
    damping = -real / np.hypot(real, imag)
    yield _over(onset, value, damping, damping, "damping ratio", "", "Damping over the value")
    hertz = imag / math.tau
    yield _over(onset, value, hertz, damping, "frequency", "Hz", "Frequency over the value")
    yield _map(onset, value, real, hertz)


def _values(onset: Onset) -> dict[str, Any]:
    name, unit = onset.axis.name, onset.axis.key.unit
    if onset.scan.logarithmic:
        return log_axis(name, unit, [sample.value for sample in onset.scan.samples])
    return axis(name, unit)


def _dots(x: Any, y: Any, value: Any, damping: Any, unit: str) -> Iterator[dict[str, Any]]:
    for name, chosen, colour, symbol in (
        ("decays", damping > 0.0, "--pass", "circle"),
        ("grows", damping <= 0.0, "--fail", "x"),
    ):
        texts = [quantity(float(each), unit) for each in value[chosen]]
        yield {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "x": numbers(x[chosen]),
            "y": numbers(y[chosen]),
            "text": texts,
            "marker": {"color": colour, "symbol": symbol, "size": 6},
            "hovertemplate": f"%{{text}}: %{{y:.4s}}<extra>{name}</extra>",
        }


def _over(
    onset: Onset, value: Any, y: Any, damping: Any, title: str, unit: str, name: str
) -> Picture:
    log = onset.scan.logarithmic
    shapes: list[dict[str, Any]] = [
        area(low, high, across="x", colour="--pass-soft") for low, high in onset.scan.stable_ranges
    ]
    shapes += [line(each.crossing.value, None, "--ink", dash="dash") for each in onset.findings]
    edge = 1 if unit else 0  # of a stable range, where a frequency is low and a damping high
    labels = [
        label(quantity(each.crossing.value, onset.axis.key.unit),
              math.log10(each.crossing.value) if log else each.crossing.value,
              edge, yref="paper", yanchor="top" if edge else "bottom", xanchor="left")
        for each in onset.findings
        if each.crossing.changes_stability
    ]  # fmt: skip
    ends: dict[str, Any] = {}
    if not unit:
        shapes.append(line(None, 0.0))
        reach = min(max(3.0 * float(np.percentile(np.abs(y), 50)), 1e-3), RINGS)
        ends = {"range": [-reach, reach]}
    elif y.max() > 5.0 * y.min():
        ends = {"type": "log"}
    layout = {
        "xaxis": _values(onset),
        "yaxis": axis(title, unit, **ends),
        "shapes": shapes,
        "annotations": labels,
        "margin": {"l": 56, "r": 14, "t": 44, "b": 44},
    }
    data = list(_dots(value, y, value, damping, onset.axis.key.unit))
    summary = (
        f"The {title} of every ringing mode over {onset.axis.name}. Shaded: stable. Dashed lines:"
        " crossings of the imaginary axis. Circles decay, crosses grow."
    )
    return Picture(name, {"data": data, "layout": layout}, summary, 340)


def _map(onset: Onset, value: Any, real: Any, hertz: Any) -> Picture:
    scale = np.log10(value) if onset.scan.logarithmic else value
    ticks = np.linspace(scale.min(), scale.max(), 5)
    shown = 10.0**ticks if onset.scan.logarithmic else ticks
    unit = onset.axis.key.unit
    bar = {
        "title": {"text": words(onset.axis.name)}, "thickness": 12, "tickvals": numbers(ticks),
        "ticktext": [quantity(float(each), unit, 3) for each in shown],
    }  # fmt: skip
    data = [
        {"type": "scatter", "mode": "markers", "x": numbers(real), "y": numbers(hertz),
         "text": [quantity(float(each), unit) for each in value],
         "marker": {"color": numbers(scale), "size": 6, "colorbar": bar,
                    "colorscale": [[0, "--negative"], [0.5, "--true"], [1, "--positive"]]},
         "hovertemplate": "%{text}: %{x:.4s}/s at %{y:.4s}Hz<extra></extra>"}
    ]  # fmt: skip
    near = np.percentile(real, (5, 95))
    width = float(near[1] - near[0]) or 1.0
    layout = {
        "xaxis": axis(
            "real part", "/s", range=[near[0] - 0.2 * width, max(near[1], 0) + 0.2 * width]
        ),
        "yaxis": axis("frequency", "Hz"),
        "shapes": [line(0.0, None)],
    }
    summary = (
        f"Poles in the upper half plane; the colour is {onset.axis.name}, from orange (smallest) to"
        " blue (largest). Right of the black line a mode grows."
    )
    return Picture("Pole map", {"data": data, "layout": layout}, summary, 400)
