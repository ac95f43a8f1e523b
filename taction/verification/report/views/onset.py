"""An onset: crossings, stable ranges, the pole map, damping and frequency over the value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from taction.system.array_types import Floats
from taction.system.charts import Axis, Band, Chart, Curve, Limit, Line, Mark, Outcome, Scale, Text
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
from taction.verification.report.views.origin import origin_section
from taction.verification.report.views.stability import mode_marks, upper_half_plane
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


def view(onset: Onset) -> Page:
    """Return the page of an onset."""
    name, unit, samples = onset.axis.name, onset.axis.key.unit, onset.scan.samples
    stable = _stable(onset)
    examined = f"{quantity(samples[0].value, unit)} to {quantity(samples[-1].value, unit)}"
    default = " (default range)" if onset.axis.default else ""
    return Page(
        title=onset.scene.name,
        command="taction onset",
        outcome="inconclusive" if onset.disagreement else "",
        summary=f"Stable for {name}: {stable}.",
        lines=(f"{name} from {examined}{default}, poles at {len(samples)} values.",),
        sections=(
            Section("Poles", lambda: _poles(onset), media=DRAWN),
            Section("Crossings", tuple(_crossings(onset)), media=BOTH),
            origin_section(onset.scene),
        ),
    )


def _stable(onset: Onset) -> str:
    found = _ranges(onset.scan.stable_ranges, onset.axis.key.unit)
    return found or "nowhere in the examined range"


def _ranges(ranges: Sequence[tuple[float, float]], unit: str) -> str:
    return "; ".join(f"{quantity(low, unit)} to {quantity(high, unit)}" for low, high in ranges)


def _crossings(onset: Onset) -> Iterator[Block]:
    unit, complete = onset.axis.key.unit, onset.scan.complete
    if not onset.findings:
        yield Notes("", ("No pole crosses the imaginary axis in this range.",))

    def unstable(count: int) -> str:
        return str(count) if complete or not count else "some"

    columns = {
        "crossing": lambda each: Cell(
            readable(show(each.crossing.value, unit, 7)), each.crossing.value
        ),
        "frequency": lambda each: (
            number_cell(each.crossing.frequency, "Hz", 5)
            if each.crossing.frequency
            else "real pole"
        ),
        "unstable poles": lambda each: (
            f"{unstable(each.crossing.below)} → {unstable(each.crossing.above)}"
        ),
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
    counts = tuple(
        (
            f"unstable poles at {quantity(count.value, unit)}",
            f"{count.poles} by eigenvalues, "
            + (count.reason if count.winding is None else f"{count.winding} by winding number"),
        )
        for count in onset.counts
    )
    yield Facts("Two counts of the unstable poles", counts)


def _remarks(onset: Onset) -> Iterator[str]:
    """Yield whether the two counts agree, what is not resolved, and what has no poles."""
    unit = onset.axis.key.unit
    if not onset.scan.complete:
        yield INCOMPLETE
    wrong = [c for c in onset.counts if c.winding is not None and c.winding != c.poles]
    if wrong:
        parts = (f"{c.winding} not {c.poles} at {quantity(c.value, unit)}" for c in wrong)
        yield f"Winding numbers contradict the poles: {', '.join(parts)}."
    elif onset.counts:
        counted = sum(c.winding is not None for c in onset.counts)
        yield f"Winding numbers agree with the poles in {counted} of {len(onset.counts)} ranges."
    if unresolved := _ranges(onset.scan.unresolved, unit):
        yield f"Not resolved, a pole is on the axis to within rounding: {unresolved}."
    failures = [sample for sample in onset.scan.samples if sample.failure]
    if failures:
        yield f"No poles at {len(failures)} of the values."
        yield from (f"{quantity(s.value, unit)}: {s.failure}" for s in failures[:FAILURES])


def direction(crossing: Edge) -> str:
    """Return the side of the crossing on which the mode grows."""
    return "unstable above" if crossing.unstable_above else "unstable below"


def _rate(side: Side | None) -> Cell | None:
    if side is None:
        return None
    measured = "–" if side.growth_rate is None else f"{side.growth_rate:+.4g}"
    return Cell(f"{measured} ({side.predicted.real:+.4g})", side.growth_rate)


Modes = tuple[Floats, Floats, Floats]  # value on the axis, real and imaginary part of the pole


def _poles(onset: Onset) -> Sequence[Block]:
    modes = _ringing(onset)
    if not len(modes[0]):
        return (Notes("", ("No pole of any value rings.",)),)
    return _damping(onset, modes), _frequency(onset, modes), _map(onset, modes)


def _ringing(onset: Onset) -> Modes:
    """Return value, real and imaginary part of every ringing pole with a positive frequency."""
    rows = [
        (sample.value, p.real, p.imag)
        for sample in onset.scan.samples
        if not sample.failure
        for p in sample.poles[: sample.known or None].tolist()
        if p.imag > 0.0 and -p.real < MAX_DAMPING * abs(p)
    ]
    value, real, imag = np.array(rows or np.zeros((0, 3))).T
    return value, real, imag


def _values(onset: Onset) -> Axis:
    """Return the axis of the examined values."""
    samples = onset.scan.samples
    scale: Scale = "log" if onset.scan.logarithmic else "linear"
    return Axis(onset.axis.name, onset.axis.key.unit, scale, (samples[0].value, samples[-1].value))


def _dots(x: Floats, y: Floats, onset: Onset, modes: Modes) -> tuple[Curve, Curve]:
    """Return the modes that decay and those that grow, each with its value for the pointer."""
    value, real, _ = modes
    texts = [quantity(each, onset.axis.key.unit) for each in value.tolist()]
    return mode_marks(x, y, real, texts, 4.0)


def _on_values(onset: Onset) -> Iterator[Mark]:
    """Yield the stable ranges and the crossings on an axis of values; each name once."""
    name = "stable"
    for low, high in onset.scan.stable_ranges:
        yield Band(low, high, "x", name, "pass")
        name = ""
    known: set[str] = set()
    for each in onset.findings:
        state = each.confirmation.confirmed
        word, outcome = STATES[state]
        if each.confirmation.reason == NOT_ASKED:
            word = "transients not run"
        name = "" if word in known else f"crossing, {word}"
        known.add(word)
        yield Limit(each.crossing.value, "x", name, outcome, LINES[state], 1.2)


def _labels(onset: Onset) -> Iterator[Text]:
    for crossing in (each.crossing for each in onset.findings):
        if crossing.changes_stability:
            text = quantity(crossing.value, onset.axis.key.unit)
            yield Text(text, crossing.value, None, ("right", "below"))


def _damping(onset: Onset, modes: Modes) -> Chart:
    value, real, imag = modes
    damping = -real / np.hypot(real, imag)
    middle = float(np.percentile(np.abs(damping), 50)) if len(damping) else 0.0
    reach = min(max(3.0 * middle, 1e-3), MAX_DAMPING)
    marks = (*_on_values(onset), Limit(0.0, "y", "", "ink", "solid"))
    return Chart(
        "Damping over the value",
        _values(onset),
        Axis("damping ratio (below 0: grows)", limits=(-reach, reach)),
        (*marks, *_dots(value, damping, onset, modes), *_labels(onset)),
        summary=f"The damping ratio of every ringing mode over {onset.axis.name}. {LOOKS}",
        legend="inside",
        message=f"stable for {onset.axis.name}: {_stable(onset)}",
        height=340,
    )


LOOKS = (
    "Shaded: stable. Vertical lines: crossings of the imaginary axis. Circles decay, crosses grow."
)


def _frequency(onset: Onset, modes: Modes) -> Chart:
    value, _, imag = modes
    hertz = imag / math.tau
    wide = len(hertz) and float(hertz.max()) > 5.0 * float(hertz.min())
    ringing = [each.crossing for each in onset.findings if each.crossing.frequency]
    x, y = np.array([(c.value, c.frequency) for c in ringing] or np.zeros((0, 2))).T
    rings = Curve(x, y, "crossing", "ink", "", "circle-open", size=8.0, label="")
    ends = (
        tuple(dict.fromkeys(quantity(float(each), "Hz") for each in (y.min(), y.max())))
        if len(y)
        else ()
    )
    return Chart(
        "Frequency over the value",
        _values(onset),
        Axis("ringing frequency", "Hz", "log" if wide else "linear"),
        (*_on_values(onset), *_dots(value, hertz, onset, modes), rings, *_labels(onset)),
        summary=f"The frequency of every ringing mode over {onset.axis.name}. {LOOKS}",
        legend="inside",
        message=f"{' to '.join(ends)} at the crossings" if ends else "no mode crosses",
        height=340,
    )


def _map(onset: Onset, modes: Modes) -> Chart:
    value, real, imag = modes
    near = _window(onset)
    most = HEADROOM * float(np.hypot(real, imag).max(initial=near[2]))
    leftmost = HEADROOM * float(real.min(initial=near[0]))
    hertz = np.array([each.crossing.frequency for each in onset.findings])
    texts = tuple(quantity(float(each), onset.axis.key.unit) for each in value)
    marks = (
        Curve(
            real, imag / math.tau, "pole", "muted", "", "circle", size=5.0, label="", hover=texts,
            shades=value, shade=_values(onset),
        ),
        Curve(np.zeros(len(hertz)), hertz, "crossing", "fail", "", "circle-open", size=9.0),
    )  # fmt: skip
    number = len(onset.findings)
    message = f"{counted(number, 'crossing')} of the axis" if number else "no crossing"
    windows = ("near the crossings", near), ("all ringing poles", (leftmost, near[1], most))
    return upper_half_plane(marks, windows, message, f"The colour is {onset.axis.name}.")


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
