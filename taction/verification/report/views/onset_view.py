"""An onset: crossings, stable ranges, the pole map, damping and frequency over the value."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taction.system.charts import (
    Axis,
    Band,
    Chart,
    Curve,
    Limit,
    Line,
    Mark,
    Outcome,
    Text,
    spread_colours,
)
from taction.system.quantities import counted, readable, show
from taction.verification.report.blocks import (
    BOTH,
    DRAWN,
    Block,
    Cell,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.texts import number_cell, outcome_cell, quantity
from taction.verification.report.views.origin_view import origin_section
from taction.verification.report.views.stability_view import mode_marks, upper_half_plane
from taction.verification.stability.edges import Edge
from taction.verification.studies.onset.onset import NOT_ASKED, Onset
from taction.verification.studies.onset.transient_trial import Side

STATES: dict[bool | None, tuple[str, Outcome]] = {
    True: ("confirmed", "pass"),
    False: ("contradicted", "fail"),
    None: ("undecided", "inconclusive"),
}
LINES: dict[bool | None, Line] = {True: "dash", False: "dashdot", None: "dot"}
MAX_DAMPING = 0.5  # damping ratio up to which a mode is on the charts
HEADROOM = 1.25
PARTS = 5  # of the values, each with a colour on the pole map
NEAR = 6  # modes of each sample, nearest the imaginary axis, that set the limits of the pole map
FAILURES = 10  # values without poles that are listed
INCOMPLETE = (
    "Large board: only the rightmost poles were computed, so the list has no modes that begin or"
    " cease to grow while other modes grow."
)
RATES = (
    "Unstable poles: the number right of the axis below and above the crossing. Rate: of growth,"
    " 1/s, fitted to a transient; in brackets the real part of the pole."
)
LOOKS = (
    "Shaded: stable. Vertical lines: crossings of the imaginary axis. Circles decay, crosses grow."
)


def view(onset: Onset) -> Page:
    """Return the page of an onset."""
    name, samples = onset.axis.name, onset.scan.samples
    examined = " to ".join(_value(onset, samples[k].value) for k in (0, -1))
    default = " (default range)" if onset.axis.default else ""
    return Page(
        title=onset.scene.name,
        command="taction onset",
        outcome="inconclusive" if onset.disagreement else "",
        summary=f"Stable for {name}: {_stable(onset)}.",
        lines=(f"{name} from {examined}{default}, poles at {len(samples)} values.",),
        sections=(
            Section("Poles", lambda: _charts(onset), media=DRAWN),
            Section("Crossings", tuple(_crossings(onset)), media=BOTH),
            origin_section(onset.scene),
        ),
    )


def _value(onset: Onset, value: float) -> str:
    return quantity(value, onset.axis.key.unit)


def _stable(onset: Onset) -> str:
    return _ranges(onset, onset.scan.stable_ranges) or "nowhere in the examined range"


def _ranges(onset: Onset, ranges: Sequence[tuple[float, float]]) -> str:
    return "; ".join(" to ".join(_value(onset, end) for end in ends) for ends in ranges)


def _crossings(onset: Onset) -> Iterator[Block]:
    unit, complete = onset.axis.key.unit, onset.scan.complete
    if not onset.findings:
        yield Notes("", ("No pole crosses the imaginary axis in this range.",))

    def unstable(edge: Edge) -> str:
        counts = (count if complete or not count else "some" for count in (edge.below, edge.above))
        return " → ".join(map(str, counts))

    columns = {
        "crossing": lambda each: Cell(
            readable(show(each.crossing.value, unit, 7)), each.crossing.value
        ),
        "frequency": lambda each: (
            number_cell(each.crossing.frequency, "Hz", 5)
            if each.crossing.frequency
            else "real pole"
        ),
        "unstable poles": lambda each: unstable(each.crossing),
        "side": lambda each: direction(each.crossing),
        "transients": lambda each: (
            "not run"
            if each.confirmation.reason == NOT_ASKED
            else outcome_cell(*STATES[each.confirmation.confirmed])
        ),
        "rate below": lambda each: _rate(each.confirmation.below),
        "rate above": lambda each: _rate(each.confirmation.above),
        "remark": lambda each: each.confirmation.reason,
    }
    if not any(each.confirmation.reason for each in onset.findings):
        del columns["remark"]
    yield Table.of("Crossings", onset.findings, columns, RATES)
    yield Notes("", tuple(_remarks(onset)))
    rows = (
        (
            f"unstable poles at {_value(onset, count.value)}",
            f"{count.poles} by eigenvalues, {other}",
        )
        for count in onset.counts
        if (other := count.reason or f"{count.winding} by winding number")
    )
    yield Facts("Two counts of the unstable poles", tuple(rows))


def _remarks(onset: Onset) -> Iterator[str]:
    """Yield whether the two counts agree, what is not resolved, and what has no poles."""
    if not onset.scan.complete:
        yield INCOMPLETE
    known = [count for count in onset.counts if count.winding is not None]
    if wrong := [count for count in known if count.winding != count.poles]:
        parts = (f"{c.winding} not {c.poles} at {_value(onset, c.value)}" for c in wrong)
        yield f"Winding numbers contradict the poles: {', '.join(parts)}."
    elif onset.counts:
        yield f"Winding numbers agree with the poles in {len(known)} of {len(onset.counts)} ranges."
    if unresolved := _ranges(onset, onset.scan.unresolved):
        yield f"Not resolved, a pole is on the axis to within rounding: {unresolved}."
    if failures := [sample for sample in onset.scan.samples if sample.failure]:
        yield f"No poles at {len(failures)} of the values."
        yield from (f"{_value(onset, s.value)}: {s.failure}" for s in failures[:FAILURES])


def direction(crossing: Edge) -> str:
    """Return the side of the crossing on which the mode grows."""
    return "unstable above" if crossing.unstable_above else "unstable below"


def _rate(side: Side | None) -> Cell | None:
    if side is None:
        return None
    measured = "–" if side.growth_rate is None else f"{side.growth_rate:+.4g}"
    return Cell(f"{measured} ({side.predicted.real:+.4g})", side.growth_rate)


def _charts(onset: Onset) -> Iterator[Block]:
    """Yield damping and frequency of every ringing pole over the value, and the pole map."""
    rows = [
        (sample.value, p.real, p.imag)
        for sample in onset.scan.samples
        if not sample.failure
        for p in sample.poles[: sample.known or None].tolist()
        if p.imag > 0.0 and -p.real < MAX_DAMPING * abs(p)
    ]
    if not rows:
        yield Notes("", ("No pole of any value rings.",))
        return
    value, real, imag = np.array(rows).T
    name, samples = onset.axis.name, onset.scan.samples
    scale: Any = "log" if onset.scan.logarithmic else "linear"
    x = Axis(name, onset.axis.key.unit, scale, (samples[0].value, samples[-1].value))
    ground, texts = tuple(_on_values(onset)), tuple(_value(onset, each) for each in value.tolist())
    ringing = [each.crossing for each in onset.findings if each.crossing.frequency]

    damping = -real / np.hypot(real, imag)
    reach = min(max(3.0 * float(np.median(np.abs(damping))), 1e-3), MAX_DAMPING)
    yield Chart(
        "Damping over the value",
        x,
        Axis("damping ratio (below 0: grows)", limits=(-reach, reach)),
        (*ground, Limit(0.0, "y", line="solid"), *mode_marks(value, damping, real, texts, 4.0)),
        f"stable for {name}: {_stable(onset)}",
        f"The damping ratio of every ringing mode over {name}. {LOOKS}",
    )
    hertz = imag / math.tau
    wide = float(hertz.max()) > 5.0 * float(hertz.min())
    at, rings = np.array([(c.value, c.frequency) for c in ringing] or np.zeros((0, 2))).T
    ends = [*dict.fromkeys(quantity(each, "Hz") for each in sorted(rings.tolist()))]
    said = " to ".join(ends[:: max(len(ends) - 1, 1)])
    crossing = Curve(at, rings, "crossing", "ink", "", "circle-open", size=8.0, label="")
    yield Chart(
        "Frequency over the value",
        x,
        Axis("ringing frequency", "Hz", "log" if wide else "linear"),
        (*ground, *mode_marks(value, hertz, real, texts, 4.0), crossing),
        f"{said} at the crossings" if ends else "no mode crosses",
        f"The frequency of every ringing mode over {name}. {LOOKS}",
    )
    near = _window(onset)
    most = HEADROOM * float(np.hypot(real, imag).max(initial=near[2]))
    leftmost = HEADROOM * float(real.min(initial=near[0]))
    level = np.array([each.crossing.frequency for each in onset.findings])
    marks = list[Mark]()
    for part, look in zip(
        np.array_split(np.unique(value), PARTS), spread_colours(PARTS), strict=True
    ):
        if len(part):
            own = np.isin(value, part)
            ends = [*dict.fromkeys(_value(onset, part[k]) for k in (0, -1))]
            hover = tuple(itertools.compress(texts, own))
            places = real[own], hertz[own], " to ".join(ends), look
            marks.append(Curve(*places, "", "circle", size=5.0, hover=hover))
    axis = np.zeros(len(level)), level
    marks.append(Curve(*axis, "crossing", "fail", "", "circle-open", size=9.0))
    message = f"{counted(len(level), 'crossing')} of the axis" if len(level) else "no crossing"
    windows = ("near the crossings", near), ("all ringing poles", (leftmost, near[1], most))
    poles = upper_half_plane(marks, windows, message, f"The colour says {name}.")
    yield replace(poles, legend="inside")


def _on_values(onset: Onset) -> Iterator[Mark]:
    """Yield the stable ranges and the crossings on an axis of values; each name once."""
    name = "stable"
    for low, high in onset.scan.stable_ranges:
        yield Band(low, high, "x", name, "pass")
        name = ""
    known: set[str] = set()
    for each in onset.findings:
        state, value = each.confirmation.confirmed, each.crossing.value
        word, outcome = STATES[state]
        if each.confirmation.reason == NOT_ASKED:
            word = "transients not run"
        name = "" if word in known else f"crossing, {word}"
        known.add(word)
        yield Limit(value, "x", name, outcome, LINES[state], 1.2)
        if each.crossing.changes_stability:
            yield Text(_value(onset, value), value, None, ("right", "below"))


def _window(onset: Onset) -> tuple[float, float, float]:
    """Return the left, right and upper limit of the pole map, 1/s."""
    near = [
        p
        for sample in onset.scan.samples
        if not sample.failure
        for p in [p for p in sample.poles.tolist() if p.imag > 0.0 and math.isfinite(p.real)][:NEAR]
        if abs(p.real) < MAX_DAMPING * abs(p)
    ]
    ringing = [each.crossing for each in onset.findings if each.crossing.frequency]
    decisive = [crossing for crossing in ringing if crossing.changes_stability]
    omega = [abs(crossing.pole) for crossing in decisive or ringing]
    top = HEADROOM * max(omega or [p.imag for p in near] or [1.0])
    real = [p.real for p in near if p.imag < top] or [-top, top]
    left, right = np.percentile(real, (5, 95)).tolist()
    least = max(0.25 * (right - left), 1e-4 * top)
    return min(HEADROOM * left, -least), max(HEADROOM * right, least), top
