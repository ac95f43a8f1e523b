"""Poles of a board, the values of C at which it is stable, and an onset of oscillation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import compress
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system import charts
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.system.quantities import quantity
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.report.blocks import Content, Page, Section, Table
from taction.verification.report.texts import Cell, Column, fields, figure, marked_cell, number_cell
from taction.verification.report.views.answer_view import origin_section
from taction.verification.stability.edges import Edge, Edges, Range
from taction.verification.stability.margin import AROUND, first_knob, stable_values
from taction.verification.stability.poles import Poles
from taction.verification.studies.onset import NOT_ASKED, Onset, Side

MOST = 100  # channels up to which the stable values of C cost some seconds
SCANNED = 32  # the same where a scan has to find them: of a knob that scales an array
FAR = 5.0  # times the size of the smallest pair, or the rightmost: pairs beyond it come by zoom
NEAR = 0.05  # least damping ratio up to which the poles of many boards are shown first
DAMPING = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.7)

LARGE = "not computed for a board of this size; `taction onset SCENE --over {}` finds it"


def stability_blocks(circuit: Circuit, poles: Poles) -> tuple[Content, ...]:
    """Return the pole map, the rightmost pole, and the stable values of the first knob."""
    lead, name = poles.rightmost, first_knob(circuit)
    rows = {
        "rightmost pole, real part": figure(lead.real, "1/s"),
        "its frequency": quantity(abs(lead.imag) / math.tau, "Hz"),
        "damping ratio of the rightmost ringing pole": f"{poles.damping_ratio:.4g}",
        "poles": str(len(poles.poles)) if poles.complete else f"rightmost {len(poles.poles)}",
    }
    word = {True: "stable", False: "not stable", None: "stable or not, which rounding hides,"}
    text = f"The board is {word[poles.stable]}"
    if not name:
        return f"{text}.".replace(",.", "."), pole_map(poles.poles), rows
    ranges, own = knob_ranges(circuit, poles), circuit.facts[name].text
    stated = f"{text} at {name} = {own}. Stable values of {name}: {ranges}."
    return stated, pole_map(poles.poles), rows


def knob_ranges(circuit: Circuit, poles: Poles) -> str:
    """Return the stable values of the first knob with a margin, or why they are not known."""
    board, name = LinearBoard(circuit), first_knob(circuit)
    most = SCANNED if circuit.scales_arrays(circuit.knob(name)) else MOST
    if len(circuit.outputs) > most or not (poles.complete or poles.stable):
        return LARGE.format(name)
    try:
        found = stable_values(board, found=poles)
    except EngineError as error:
        return f"not known: {error}"
    words = ranges_text(found, found.low, found.high, circuit.facts[name].unit)
    return f"{words} (from {name}/{AROUND:g} to {AROUND:g} {name})"


def ranges_text(found: Edges, low: float, high: float, unit: str = "F") -> str:
    """Return the stable values between two ends in words."""
    near = ", ".join(quantity(value, unit) for value in found.near)
    text = ranges_words(found.stable_ranges, low, high, unit)
    return text + (f"; rounding decides near {near}" if near else "")


def ranges_words(ranges: Sequence[Range], low: float, high: float, unit: str) -> str:
    """Return ranges between two ends in words."""
    parts = []
    for first, last in ranges:
        begin, end = quantity(first, unit), quantity(last, unit)
        if first <= low and last >= high:
            parts.append("every value")
        elif last >= high > first:
            parts.append(f"above {begin}")
        elif first <= low < last:
            parts.append(f"below {end}")
        elif low < last and first < high:
            parts.append(f"{begin} to {end}")
    return "; ".join(parts) or "none"


def pole_map(poles: Complexes, texts: Sequence[str] = ()) -> charts.Chart:
    """Return the upper half plane with poles (P,), 1/s; those of many boards have `texts` each."""
    upper = poles.imag >= 0.0
    values, texts = poles[upper], [*compress(texts, upper)]
    left, right, top = _near_axis(values) if texts else _window(values)
    size, hertz = 4.0 if texts else 6.0, values.imag / math.tau
    marks: list[charts.Mark] = [*mode_marks(values.real, hertz, values.real, size, texts)]
    beyond, above, far = values.real < left, values.imag > top, list[str]()
    if beyond.any():
        end = figure(float(values.real.min()), "1/s", 2)
        far.append(f"← {beyond.sum()} farther, to {end}")
    if (above := above & ~beyond).any():
        end = figure(float(values[above].imag.max()) / math.tau, "Hz", 2)
        far.append(f"↑ {above.sum()} farther, to {end}")
    if far:
        marks.append(charts.Text("; ".join(far), None, None, ("right", "below")))
    reach = 1.5 * max(math.hypot(left, top), float(np.abs(values).max(initial=0.0)))
    ends = [(-z * reach, math.sqrt(1.0 - z**2) * reach / math.tau) for z in DAMPING]
    lines = charts.segments([((0.0, 0.0), end) for end in ends])
    ground = (
        charts.Band(0.0, reach, "x", colour="fail"),
        charts.Limit(0.0, "x", line="solid"),
        charts.Curve(*lines, "equal damping", "band", width=1.0, label="", behind=True),
        charts.Text("grows →", None, None, ("left", "above")),
    )
    ratios = ", ".join(f"{zeta:g}" for zeta in DAMPING)
    return charts.Chart(
        "Pole map",
        charts.Axis("real part", "1/s", limits=(left, right)),
        charts.Axis("frequency", "Hz", limits=(0.0, top / math.tau)),
        (*ground, *marks),
        "The upper half plane; in the shaded part a mode grows. Poles of the linearised board."
        f" Circles decay, crosses grow. On a thin line the damping ratio is {ratios},"
        " from the axis to the left.",
    )


def mode_marks(
    x: Floats, y: Floats, real: Floats, size: float = 6.0, texts: Sequence[str] = ()
) -> tuple[charts.Curve, charts.Curve]:
    """Return the modes (P,) that decay, as circles, and that grow, as crosses; `real`, 1/s."""

    def marks(name: str, outcome: str, mark: str, chosen: np.ndarray) -> charts.Curve:
        hover = tuple(compress(texts, chosen))
        return charts.Curve(x[chosen], y[chosen], name, outcome, "", mark, size=size, hover=hover)

    return marks("decays", "pass", "circle", real < 0.0), marks("grows", "fail", "x", real >= 0.0)


def _window(values: Complexes) -> tuple[float, float, float]:
    """Return what is shown first: the pairs, or slow real poles; see `_around`."""
    pairs = values[values.imag > 0.0]
    shown = pairs if len(pairs) else values
    sizes = np.abs(shown)
    near = shown[sizes <= FAR * max(sizes.min(initial=math.inf), *sizes[:1].tolist(), 0.0)]
    return _around(near, float(near.real.min(initial=0.0)))


def _near_axis(values: Complexes) -> tuple[float, float, float]:
    """Return what is shown first of many boards: as far to the left as modes grow, or so."""
    reach = max(float(values.real.max()), NEAR * float(np.abs(values).min()))
    near = values[values.real >= -reach]
    return _around(near, -reach) if len(near) else _window(values)


def _around(values: Complexes, left: float) -> tuple[float, float, float]:
    """Return the left, right and upper limit of a view, 1/s; the axis is always in it."""
    right = max(float(values.real.max(initial=0.0)), 0.0)
    width = (right - min(left, 0.0)) or 1.0
    top = float(values.imag.max(initial=0.0)) or math.tau * width
    return min(float(left), 0.0) - 0.1 * width, right + 0.3 * width, 1.25 * top


STATES: dict[bool | None, tuple[str, charts.Outcome]] = {
    True: ("confirmed", "pass"),
    False: ("contradicted", "fail"),
    None: ("undecided", "inconclusive"),
}
LINES: dict[bool | None, charts.Line] = {True: "dash", False: "dashdot", None: "dot"}
MAX_DAMPING = 0.5  # damping ratio up to which a mode is on the charts
FAILURES = 10  # values without poles that are listed
INCOMPLETE = (
    "Large board: only the rightmost poles were computed, so the list has no modes that begin or"
    " cease to grow while other modes grow."
)
RATES = (
    "Unstable poles: the number right of the axis below and above the crossing. Rate: of growth,"
    " 1/s, fitted to a transient; in brackets the real part of the pole."
)
SECOND = "A second count of unstable poles, by the windings of one board's Nyquist loci,"
LOOKS = (
    "Shaded: stable. Vertical lines: crossings of the imaginary axis. Circles decay, crosses grow."
)


def onset_view(onset: Onset) -> Page:
    """Return the page of an onset."""
    name, samples = onset.axis.name, onset.scan.samples
    examined = " to ".join(_value(onset, samples[k].value) for k in (0, -1))
    default = " (default range)" if onset.axis.default else ""
    stable = _ranges(onset, onset.scan.stable_ranges) or "nowhere in the examined range"
    return Page(
        title=onset.scene.name,
        command="taction onset",
        outcome="" if onset.outcome == "pass" else onset.outcome,
        summary=f"Stable for {name}: {stable}.",
        lines=(f"{name} from {examined}{default}, poles at {len(samples)} values.",),
        sections=(
            Section("Poles", lambda: _charts(onset), media="page picture"),
            Section("Crossings", tuple(_crossings(onset))),
            origin_section(onset.scene),
        ),
    )


def _value(onset: Onset, value: float) -> str:
    return quantity(value, onset.axis.key.unit)


def _ranges(onset: Onset, ranges: Sequence[tuple[float, float]]) -> str:
    return "; ".join(" to ".join(_value(onset, end) for end in ends) for ends in ranges)


def _crossings(onset: Onset) -> Iterator[Content]:
    """Yield the crossings, and what is not resolved or not known."""
    unit, complete, name = onset.axis.key.unit, onset.scan.complete, onset.axis.name
    if not onset.findings:
        yield "No pole crosses the imaginary axis in this range."

    def unstable(edge: Edge) -> str:
        counts = (count if complete or not count else "some" for count in (edge.below, edge.above))
        return " → ".join(map(str, counts))

    def rate(side: Side | None) -> Cell | None:
        if side is None:
            return None
        growth = None if side.measured is None else side.measured.growth_rate
        measured = "–" if growth is None else f"{growth:+.4g}"
        return Cell(f"{measured} ({side.predicted.real:+.4g})", growth)

    columns: dict[str, Column] = {
        **fields(f"crossing = crossing.value {unit or 'ratio'} 7"),
        "frequency": lambda each: frequency_cell(each.crossing, 5),
        "unstable poles": lambda each: unstable(each.crossing),
        "side": "direction",
        "transients": lambda each: (
            "not run" if each.reason == NOT_ASKED else marked_cell(*STATES[each.confirmed])
        ),
        "rate below": lambda each: rate(each.below),
        "rate above": lambda each: rate(each.above),
    }
    if any(each.reason for each in onset.findings):
        columns["remark"] = "reason"
    yield Table.of("Crossings", onset.findings, columns, RATES)
    if counts := onset.scan.counts:
        wrong = [_value(onset, at) for at, own, loci in counts if own != loci]
        agree = f"agrees in {len(counts) - len(wrong)} of {len(counts)} ranges of {name}"
        yield f"{SECOND} {agree}{', not at ' * bool(wrong)}{', '.join(wrong)}."
    if not complete:
        yield INCOMPLETE
    if unresolved := _ranges(onset, onset.scan.unresolved):
        yield f"Not resolved, a pole is on the axis to within rounding: {unresolved}."
    if onset.failures:
        yield f"No poles at {len(onset.failures)} of the values."
        yield from (f"{_value(onset, s.value)}: {s.failure}" for s in onset.failures[:FAILURES])


def frequency_cell(edge: Any, digits: int = 6) -> Cell | str:
    """Return the frequency of a pole, or of an edge, Hz; a real one has none."""
    return number_cell(edge.frequency, "Hz", digits) if edge.frequency else "real pole"


def _charts(onset: Onset) -> Iterator[Content]:
    """Yield the paths of ringing poles, and their damping and frequency over the value."""
    name, samples = onset.axis.name, [each for each in onset.scan.samples if not each.failure]
    rows = [
        (sample.value, p.real, p.imag)
        for sample in samples
        for p in sample.poles[: sample.known or None].tolist()
        if p.imag > 0.0 and -p.real < MAX_DAMPING * abs(p)
    ]
    if not rows:
        yield "No pole of any value rings."
        return
    value, real, imag = np.array(rows).T
    edges = [each.crossing for each in onset.findings]
    at, rings = np.array([(c.value, c.frequency) for c in edges if c.frequency]).reshape(-1, 2).T
    crossing = charts.Curve(at, rings, "crossing", "ink", "", "circle-open", size=8.0, label="")
    on_axis = replace(crossing, x=0.0 * at, label="legend")
    yield _root_locus(onset, value, real + 1j * imag, on_axis)
    hertz, damping = imag / math.tau, -real / np.hypot(real, imag)
    scale: Any = "log" if onset.scan.logarithmic else "linear"
    ends = tuple(onset.scan.samples[k].value for k in (0, -1))
    x = charts.Axis(name, onset.axis.key.unit, scale, (ends[0], ends[1]))
    ground = tuple(_on_values(onset))
    reach = min(max(3.0 * float(np.median(np.abs(damping))), 1e-3), MAX_DAMPING)
    wide = float(hertz.max()) > 5.0 * float(hertz.min())
    zero = charts.Limit(0.0, "y", line="solid")
    ratio = charts.Axis("damping ratio (below 0: grows)", limits=(-reach, reach))
    frequency = charts.Axis("ringing frequency", "Hz", "log" if wide else "linear")
    for what, y, values, first, last in (
        ("damping ratio", ratio, damping, (zero,), ()),
        ("frequency", frequency, hertz, (), (crossing,)),
    ):
        drawn = (*ground, *first, *mode_marks(value, values, real, 4.0), *last)
        title = f"{what.partition(' ')[0].capitalize()} over the value"
        summary = f"The {what} of every ringing mode over {name}. {LOOKS}"
        yield charts.Chart(title, x, y, drawn, summary)


def _root_locus(
    onset: Onset, value: Floats, poles: Complexes, crossings: charts.Curve
) -> charts.Chart:
    """Return the map of the poles (P,), 1/s, of boards of a value (P,)."""
    name, marks = onset.axis.name, [crossings]
    drawn = pole_map(poles, [f"{name} = {_value(onset, each)}" for each in value.tolist()])
    for at, mark in ((float(value.min()), "diamond-open"), (float(value.max()), "square-open")):
        x, y, text = poles.real, poles.imag / math.tau, f"{name} = {_value(onset, at)}"
        own = value == at
        marks.append(charts.Curve(x[own], y[own], text, "ink", "", mark, size=9.0))
    summary = f"The poles with a damping ratio below {MAX_DAMPING:g}, as {name} moves from diamonds"
    summary += f" to squares; open circles: crossings of the axis. {drawn.summary}"
    return replace(drawn, title="Root locus", marks=(*drawn.marks, *marks), summary=summary)


def _on_values(onset: Onset) -> Iterator[charts.Mark]:
    """Yield the stable ranges and the crossings on an axis of values; each name once."""
    known: set[str] = set()

    def once(name: str) -> str:
        new = name not in known
        known.add(name)
        return name * new

    for low, high in onset.scan.stable_ranges:
        yield charts.Band(low, high, "x", once("stable"), "pass")
    for each in onset.findings:
        state, value = each.confirmed, each.crossing.value
        word, outcome = STATES[state]
        if each.reason == NOT_ASKED:
            word = "transients not run"
        yield charts.Limit(value, "x", once(f"crossing, {word}"), outcome, LINES[state], 1.2)
        if each.crossing.changes_stability:
            yield charts.Text(_value(onset, value), value, None, ("right", "below"))
