"""Verdicts beside others: a regression run, two boards, several files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from taction.system import charts
from taction.system.array_types import Floats
from taction.system.documents import read
from taction.system.quantities import counted, quantity, readable, spaced
from taction.verification.report.blocks import Bars, Content, Notes, Page, Section, Table
from taction.verification.report.texts import (
    Cell,
    Column,
    fields,
    figure,
    is_small,
    marked_cell,
    number_cell,
)
from taction.verification.report.views import waveforms_view as waveforms
from taction.verification.report.views.answer_view import check_bar, margin_lines, origin_section
from taction.verification.studies.regression.difference import VerdictDifference
from taction.verification.studies.regression.regress import RegressionReport, SceneResult, Status
from taction.verification.studies.scene_files import VerifiedFiles
from taction.verification.verdict.checks import Check, band_text, causes
from taction.verification.verdict.record import Difference

SHOWN = 12  # changed quantities of a scene in a terminal; the page and JSON have them all
LEAST_OFF = 1e-3  # tolerances: a smaller difference has no number
STATUSES: dict[Status, charts.Outcome] = {
    Status.SAME: "pass",
    Status.NEWLY_PASSING: "pass",
    Status.NEW: "inconclusive",
    Status.NOT_RUN: "inconclusive",
    Status.NO_VERDICT: "inconclusive",
}
EXITS: dict[int, charts.Outcome] = {0: "pass", 1: "fail"}


def regression_view(report: RegressionReport) -> Page:
    """Return the page of a regression run."""
    columns: dict[str, Column] = {
        "scene": lambda each: each.file.removesuffix(".toml"),
        "status": lambda each: marked_cell(each.status.value, STATUSES.get(each.status, "fail")),
        "checks": lambda each: _passing(each.checks),
        "tolerances off": lambda each: None if each.worst is None else _off(each.worst),
        "simulator": lambda each: each.entry and each.entry.solved_by.partition(",")[0],
    }
    scenes = Table.of("Scenes", report.results, columns)
    counts = ", ".join(f"{count} {status}" for status, count in report.count().items())
    return Page(
        title=report.folder,
        command="taction regress",
        outcome=EXITS.get(report.exit_status, "inconclusive"),
        summary=f"{report.folder} against {report.baseline}: {counts}",
        lines=(
            *(("The run was interrupted.",) if report.interrupted else ()),
            *((f"Not stored, a check fails: {', '.join(report.left)}.",) if report.left else ()),
        ),
        sections=(
            Section("Scenes", scenes),
            *(section for each in report.results for section in _scene(each)),
            origin_section(None, (("baseline", report.baseline),)),
        ),
    )


def _passing(checks: Iterable[Check]) -> str | None:
    """Return how many checks pass; None without a verdict."""
    passed = [check.outcome.value == "pass" for check in checks]
    return f"{sum(passed)} of {len(passed)} pass" if passed else None


def _scene(result: SceneResult) -> tuple[Section, Section]:
    """Return what changed in a scene, and its output, which a page draws."""
    title = f"{result.file}: {result.status.value}"
    drawn = Section(title, lambda: _output(result), media="page")
    return Section(title, tuple(_changes(title, result))), drawn


def _changes(title: str, result: SceneResult) -> Iterator[Content]:
    """Yield what changed in a scene; a terminal shows the largest changes."""
    lines = tuple(map(readable, remarks(result)))
    if result.status is Status.SAME or not (result.changes or lines):
        return
    columns: dict[str, Column] = {
        "what": "label",
        **{title: partial(_stored, name=name) for title, name in VALUES.items()},
        "times": lambda each: _off(each.off),
        "note": "note words",
    }
    yield Notes(title, lines)
    note = "Times: the difference over the tolerance."
    yield Table.of("Changes", result.changes, columns, note, {"terminal": SHOWN})
    yield Bars("Checks", tuple(map(check_bar, result.checks)), brief=True)


def _output(result: SceneResult) -> charts.Chart | None:
    """Return the output whose readings changed most, now and in the baseline, if both have it."""
    n = next((each.channel for each in result.changes if each.channel), 1)
    both = [(entry and entry.curves) or () for entry in (result.baseline, result.entry)]
    if n > min(map(len, both)) or not result.changes:
        return None
    then, now = ([np.array(text.split(), float) for text in curves[n - 1]] for curves in both)
    text = "Dashed: the baseline. The output is the first in the table of changes, else u1."
    old = charts.Curve(then[0], then[1], "baseline", "muted", "dash", width=2.5)
    new = charts.Curve(now[0], now[1], "now")
    title, axes = f"Output u{n}, now and in the baseline", (charts.TIME, charts.Axis("output", "V"))
    return charts.Chart(title, *axes, (old, new), text, height=300)


VALUES = {
    "value": "second", "baseline": "first", "difference": "difference", "tolerance": "allowed",
}  # fmt: skip


def _stored(change: Difference, name: str) -> str:
    return stored_value(getattr(change, name), change.unit)


def _off(off: float) -> Cell:
    return Cell(off_text(off), off if math.isfinite(off) else None)


def change_line(change: Difference) -> str:
    """Return a changed quantity as one line of text."""
    now, then = stored_value(change.second, change.unit), stored_value(change.first, change.unit)
    text = f"{change.label}: {now}, baseline {then}"
    if change.allowed is not None:
        text += f", tolerance {stored_value(change.allowed, change.unit)}"
        text += f", {off_text(change.off)} tolerances off"
    return f"{text} ({change.note})" if change.note else text


def remarks(result: SceneResult) -> list[str]:
    """Return what explains the changes of a scene, and why it does not pass, in lines."""
    reasons = [found.text for found in causes(result.checks)] if result.checks else [result.reason]
    return [*result.notes, *filter(None, reasons)]


def off_text(off: float) -> str:
    """Return a difference in tolerances, or "differs" for values that cannot be compared."""
    if 0.0 < off < LEAST_OFF:
        return f"under {LEAST_OFF:g}"
    return f"{off:.3g}" if math.isfinite(off) else "differs"


def stored_value(value: float | str | None, unit: str) -> str:
    """Return a value with its unit and six digits; a part of the step is a plain number."""
    return figure(value, "" if unit == "step" else unit, 6)


RATIOS = 16  # readings of a chart
WIDE = 10.0  # times the least ratio: a scale that is logarithmic
RATIO = (
    "Readings of B over those of A, the most different first; those within their uncertainties, or"
    " without a ratio, are left out."
)
POINTS = 20_000  # of all curves of one board
BEYOND: dict[bool | None, tuple[str, charts.Outcome]] = {
    True: ("yes", "fail"),
    False: ("no", "pass"),
    None: ("unknown", "inconclusive"),
}


def difference_view(difference: VerdictDifference) -> Page:
    """Return the page of a difference."""
    return Page(
        title=f"{difference.first} and {difference.second}",
        command="taction diff",
        outcome=EXITS.get(difference.exit_status, "inconclusive"),
        summary=_summary(difference),
        lines=(f"A: {difference.first}", f"B: {difference.second}", *difference.notes),
        sections=(
            Section("Keys", _keys(difference)),
            Section("Readings", _readings(difference)),
            Section("Ratios", lambda: _ratios(difference), media="page picture"),
            Section("Waveforms", lambda: _outputs(difference), media="page picture"),
        ),
    )


def _summary(difference: VerdictDifference) -> str:
    shown = [reading.beyond for reading in difference.readings if reading.first != reading.second]
    beyond, within, unknown = (shown.count(each) for each in (True, False, None))
    text = f"{len(difference.readings)} readings: {len(difference.readings) - len(shown)} equal,"
    text += f" {within} within their uncertainties, {beyond} beyond"
    return text + (f", {unknown} unknown" if unknown else "")


def _keys(difference: VerdictDifference) -> Content:
    if difference.keys is None:
        return "parts: not compared; a record has none"
    if not difference.keys:
        return "keys: no difference"
    columns: dict[str, Column] = {
        **fields("key; A = first @unit 6"),
        "B": lambda each: figure(each.second, each.unit, 6) + " (another content)" * each.content,
    }
    return Table.of("Keys", difference.keys, columns)


def _readings(difference: VerdictDifference) -> Table:
    columns = {
        "reading": lambda each: _name(each, difference.outputs),
        **fields("A = first @unit 6; B = second @unit 6; B - A = difference @unit 3"),
        "±": allowed_cell,
        "beyond ±": lambda each: marked_cell(*BEYOND[each.beyond]),
    }
    changed = (each for each in difference.readings if each.first != each.second)
    return Table.of("Readings", changed, columns)


def _ratios(difference: VerdictDifference) -> charts.Chart | None:
    """Return the readings of B over those of A, the most different ones first."""
    found = [
        (each.second / each.first, each)
        for each in difference.readings
        if isinstance(each.first, float) and isinstance(each.second, float)
        if each.beyond is not False and each.first * each.second > 0.0
    ]
    rows = sorted(found, key=lambda row: -abs(math.log(row[0])))[:RATIOS]
    if not rows:
        return None
    marks: list[charts.Mark] = [charts.Limit(1.0, "x", "equal")]
    for beyond, (word, look) in BEYOND.items():
        places = [n for n, (_, each) in enumerate(rows) if each.beyond is beyond]
        ratios, mark = [rows[n][0] for n in places], charts.OUTCOMES[look].mark
        name = f"beyond ±: {word}"
        marks += [charts.Curve(ratios, places, name, look, "", mark)] if places else []
    names = tuple(_name(each, difference.outputs) for _, each in rows)
    ends = [ratio for ratio, _ in rows]
    x = charts.Axis("B over A", scale="log" if max(ends) > WIDE * min(ends) else "linear")
    y = charts.Axis(scale="names", names=names, reverse=True)
    title, height = f"{len(rows)} of {len(found)} readings that differ", 140 + 22 * len(rows)
    return charts.Chart(title, x, y, tuple(marks), RATIO, height=height)


def allowed_cell(reading: Difference) -> Cell:
    """Return the sum of the bounds of both readings."""
    size = max((abs(x) for x in (reading.first, reading.second) if isinstance(x, float)), default=0)
    small = bool(reading.allowed) and is_small(reading.allowed, size, reading.unit)
    text = "1 ppm or better" if small else figure(reading.allowed, reading.unit, 2)
    return Cell(text, reading.allowed)


def _name(reading: Difference, outputs: tuple[str, ...]) -> str:
    if reading.group == "waveforms":
        return f"waveform {reading.name}, {reading.note}"
    name = f"check {spaced(reading.name)}" if reading.group == "checks" else spaced(reading.name)
    name = f"{name} {reading.note}".rstrip()
    if not reading.channel:
        return name
    return f"{outputs[reading.channel - 1] if outputs else f'u_{reading.channel}'} {name}"


def _outputs(difference: VerdictDifference) -> Iterator[Content]:
    """Yield the outputs of both over time, where both have waveforms."""
    first, second = (each and each() for each in difference.curves)
    if not first or not second:
        yield "No waveforms: one of them leaves the range of floats."
        return
    (time, u), (other, v) = first, second
    count = min(u.shape[1], v.shape[1])
    names = difference.outputs or [f"u_{n + 1}" for n in range(count)]

    def drawn(x: Floats, values: Floats, line: charts.Line, width: float) -> Iterator[charts.Curve]:
        return waveforms.curves(x, values[:, :count], names, line=line, width=width, points=POINTS)

    def named(group: Iterable[int]) -> str:
        known = difference.outputs
        return ", ".join(known[n] for n in group) if known else waveforms.channel_names(group)

    both = np.concatenate([u[:, :count], v[:, :count]])
    ends = u[-1, :count].tolist(), float(both.min()), float(both.max())
    few, looks = count <= waveforms.LABELLED, charts.spread_colours(count)
    texts = waveforms.end_names(*ends, looks, named) if few else ()
    marks = *drawn(time, u, "solid", 2.2), *drawn(other, v, "dash", 1.2), *texts
    text = f"Solid: A, {difference.first}. Dashed: B, {difference.second}."
    yield charts.Chart("Outputs", charts.TIME, charts.Axis("output", "V"), marks, text, height=420)
    inside = time[(time >= other[0]) & (time <= other[-1])]
    places = np.searchsorted(time, inside)
    apart = [np.interp(inside, other, v[:, n]) - u[places, n] for n in range(count)]
    if len(inside):
        lines = tuple(drawn(inside, np.transpose(apart), "solid", 1.2))
        most = quantity(float(np.abs(apart).max()), "V", 3)
        axes = charts.TIME, charts.Axis("difference", "V")
        yield charts.Chart(f"B minus A: at most {most} apart", *axes, lines, height=300)


Document = Mapping[str, Any]


def files_view(files: VerifiedFiles) -> Page:
    """Return the page of the verdicts of several files."""
    counts = ", ".join(f"{count} {name}" for name, count in files.count().items())
    columns: dict[str, Column] = {
        "scene": "file",
        "outcome": lambda each: marked_cell(each["outcome"], _outcome(each["outcome"])),
        "checks": lambda each: _passing(checks_of(each)),
        "settling": _settling,
        "overshoot": lambda each: number_cell(_largest(each, "overshoot"), "step"),
        "time": lambda each: number_cell(each.get("timing", {}).get("total"), "s", 3),
    }
    remarks = (
        Notes(f"{each['file']}: {each['outcome']}", tuple(_remark_lines(each)))
        for each in files.documents
    )
    return Page(
        title=counted(len(files.documents), "scene"),
        command="taction verify",
        outcome=_outcome(files.outcome),
        last_line=files.outcome,
        summary=f"{counted(len(files.documents), 'scene')}: {counts}",
        sections=(
            Section("Scenes", Table.of("Scenes", files.documents, columns)),
            Section("Remarks", tuple(remarks)),
        ),
    )


def _settling(document: Document) -> Cell:
    """Return a settling time with its band, which each file has of its own."""
    cell = number_cell(document.get("settling_time"), "s")
    bands = filter(None, map(band_text, checks_of(document)))
    return cell if cell.number is None else replace(cell, text=" ".join((cell.text, *bands)))


def _outcome(name: str) -> charts.Outcome:
    """Return the outcome whose look a file has: bad input looks like a failure."""
    return name if name in charts.OUTCOMES else "fail" if name == "bad input" else "inconclusive"


def _remark_lines(document: Document) -> Iterator[str]:
    yield from reasons(document)
    yield from (f"warning: {text}" for text in document.get("warnings", ()))
    yield from margin_lines(document)


def reasons(document: Document) -> Iterator[str]:
    """Yield why a file does not pass: each cause, or its error."""
    if "error" in document:
        yield document["error"]["message"]
    if "checks" in document:
        yield from (found.text for found in causes(checks_of(document)))


def checks_of(document: Document) -> tuple[Check, ...]:
    """Return the checks of a verdict's document; without a verdict there are none."""
    return tuple(read(Check, check) for check in document.get("checks", ()))


def _largest(document: Document, name: str) -> float | None:
    """Return the largest `name` of the channels; None without one, or for a board that grows."""
    if document.get("stability", {}).get("stable") is not True:
        return None
    values = [channel[name] for channel in document.get("channels", ())]
    known = [value for value in values if value is not None and math.isfinite(value)]
    return max(known, default=None)
