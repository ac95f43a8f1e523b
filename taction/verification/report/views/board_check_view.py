"""A board that `taction check` examined: checks, outputs, poles, parts, and sweeps of values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from taction.system.charts import SERIES, TIME, Axis, Chart, Curve, Limit, Mark
from taction.system.quantities import banded, quantity, spaced
from taction.verification.report.blocks import Bars, Content, Page, Section, Table
from taction.verification.report.texts import (
    KNOWN,
    Cell,
    Column,
    fields,
    figure,
    is_small,
    number_cell,
    titled,
    with_error,
)
from taction.verification.report.views import tolerance_view as tolerance
from taction.verification.report.views.answer_view import MARGINS, check_bar, decisive_text
from taction.verification.report.views.stability_view import frequency_cell, pole_map, ranges_words
from taction.verification.studies.decks.board_check import BoardCheck, OutputRow
from taction.verification.studies.decks.board_sweep import PointRow, Sweep
from taction.verification.studies.decks.measured_board import PartRow
from taction.verification.studies.decks.questions import QUESTIONS, Question
from taction.verification.verdict.checks import Check, Outcome, overall

POLES, PARTS, POINTS = 12, 12, 31  # rows in a terminal
LEADS = {"pass": "", "fail": "Fails: ", "inconclusive": "Not decided: "}
RINGS = 0.3  # damping ratio below which the summary says first that the board rings
PART_WORDS = (
    "Moves the pole by: the change of the rightmost pole, 1/s and Hz, for 1 % more of the value."
)
EDGE_WORDS = {
    True: " Unstable below and above: the nearest values with a pole on the imaginary axis, within"
    " a factor of 100.",
    False: " Stable below and above: the nearest values with which it is stable, within a factor of"
    " 100, if nothing else changes.",
    None: "",
}


def view(found: BoardCheck) -> Page:
    """Return the page of a check."""
    return Page(
        title=found.circuit.name,
        command="taction check",
        outcome=found.outcome.value,
        summary=_summary(found),
        lines=found.notes,
        sections=(
            Section("Checks", Bars("", tuple(map(check_bar, found.checks)), MARGINS)),
            Section("Outputs", lambda: _outputs(found)),
            Section("Poles", lambda: _poles(found)),
            Section("Pole map", lambda: pole_map(found.poles.poles), media="page picture"),
            Section("Step response", lambda: _response(found), media="page picture"),
            Section("Parts", lambda: _parts(found)),
            *(
                Section(f"Over {each.name}", partial(_sweep, each, found.measurements.band))
                for each in found.sweeps
            ),
            *_varied(found),
        ),
        foot=(_witness(found),),
    )


def _summary(found: BoardCheck) -> str:
    text, stable = _stability(found), found.poles.stable is True
    said = {"stability"} if stable else {"stability", "margin"}
    others = [check for check in found.checks if _kind(check) not in said]
    undecided = any(_kind(c) in said and c.outcome.value != "pass" for c in found.checks)
    counted = others if undecided else found.checks  # the text says why it is not stable
    if others and not (undecided and overall(others).value == "pass"):
        outcome = overall(counted).value
        text += f" {LEADS[outcome]}{decisive_text(counted, outcome).rstrip('.')}."
    if found.corners is None or found.yields is None:
        return text
    worst = {name: None for corner in found.corners.corners for name in corner.result.record.failed}
    failing = f"{', '.join(map(spaced, worst))} not kept" if worst else "all checks pass"
    share = found.yields
    return f"{text} Worst cases: {failing}; {share.sentence}."


def _kind(check: Check) -> str:
    """Return the name of a check; a margin has that of stability, and a ratio for its unit."""
    return "margin" if check.name == "stability" and check.unit == "ratio" else check.name


def _stability(found: BoardCheck) -> str:
    """Return whether the board is stable, with the sentence that a designer needs most."""
    lead = found.poles.rightmost
    at = f" at {quantity(abs(lead.imag) / math.tau, 'Hz')}" if lead.imag else ""
    rate = figure(abs(lead.real), "1/s")
    if found.poles.doubt:
        return f"Not decided whether it is stable: {found.poles.doubt}."
    if found.poles.stable is None:
        return f"Not decided: a pole is on the imaginary axis to within rounding{at}."
    if not len(found.poles.poles):
        if len(found.apart.hidden):
            return "Stable: no output shows a pole, the outputs follow the sources at once."
        return "The board has no poles: it follows its sources at once."
    if found.poles.stable is False:
        if any(
            check.name == "oscillates" and check.outcome.value == "pass" for check in found.checks
        ):
            return f"Oscillates{at}, growing with {rate}."
        how = f"oscillates{at}, growing with {rate}" if lead.imag else f"runs away with {rate}"
        return f"Not stable: {how}; {found.remedy}. {_nearest_stable(found)}".rstrip()
    slowest = f"the slowest mode decays with {rate}{at}"
    ringing = min(found.scales.ringing, key=damping_ratio, default=None)
    if ringing is None or damping_ratio(ringing) >= RINGS:
        return f"Stable: {slowest}."
    ratio = (
        f"damping ratio {damping_ratio(ringing):.2g} at {quantity(ringing.imag / math.tau, 'Hz')}"
    )
    over = found.measurements.readings["overshoot"]
    beyond = "" if over is None else f", overshoot {figure(over.value, 'step', 3)}"
    return f"Stable, but rings: {ratio}{beyond}; {slowest}."


def damping_ratio(pole: complex) -> float:
    """Return ``-Re p / |p|`` of a mode that rings."""
    return -pole.real / abs(pole)


def _nearest_stable(found: BoardCheck) -> str:
    """Return the nearest value of a part that makes a board stable."""
    ends = [
        (max(end / each.value, each.value / end), f"{each.name} {side}", end, each)
        for each in found.parts
        for side, end in (("below", each.below), ("above", each.above))
        if end and each.value and not each.doubt
    ]
    if not ends:
        known = found.parts and not any(each.doubt for each in found.parts)
        text = "No value of one part alone, within a factor of 100, makes it stable."
        return text if known else ""
    factor, name, end, part = min(ends, key=lambda each: each[0])
    values = [figure(each, part.unit or "ratio", 4) for each in (end, part.value)]
    return f"Nearest stable value: {name} {values[0]} (now {values[1]}, factor {factor:.4g})."


def _outputs(found: BoardCheck) -> Iterator[Content]:
    amplitude = found.measurements.amplitude
    columns = {
        "output": lambda each: each.name,
        "before": lambda each: number_cell(
            each.before if abs(each.before) > each.rest_bound else 0.0, "V", 6
        ),
        "at rest": lambda each: _with(each.rest, each.rest_bound, "V", 5, amplitude),
        **_answers(found.measurements.band, over=False),
    }
    step = f"Shares of the largest step, {quantity(amplitude, 'V')}. " * (amplitude > 0.0)
    yield Table.of("", found.outputs, columns, f"{step}{KNOWN}")
    yield f"-: {why}" if found.poles.known_stable and (why := found.measurements.reason) else ""
    yield f"output noise: {found.noise.unknown}" if found.noise.unknown else ""


def _answers(band: float, *, over: bool) -> dict[str, Callable[[Any], Cell]]:
    """Return a column for each question, or for each one that a sweep shows."""
    return {
        banded(each.title, band) if each.second == "band" else each.title: partial(_answer, each)
        for each in QUESTIONS.values()
        if each.over or not over
    }


def _answer(question: Question, row: OutputRow | PointRow) -> Cell:
    value, bound = (row.figures.get(key) for key in (question.name, question.bound))
    return _with(value, bound, question.unit)


def _with(
    value: float | None, error: float | None, unit: str, digits: int = 5, whole: float = 0.0
) -> Cell:
    small = value is not None and is_small(error, value, unit, whole)
    return Cell(figure(value, unit, digits) if small else with_error(value, error, unit), value)


def _poles(found: BoardCheck) -> Table:
    columns: dict[str, Column] = {
        "real part": lambda each: _with(each.real, each.bound, "1/s"),
        "frequency": frequency_cell,
        "damping ratio": lambda each: f"{each.damping:.4g}",
    }
    if any(each.hidden for each in found.pole_rows):
        columns["shown"] = lambda each: "by no output" if each.hidden else ""
    return Table.of("", found.pole_rows, columns, most={"terminal": POLES})


def _parts(found: BoardCheck) -> Table:
    def edge(part: PartRow, side: str) -> Cell:
        undecided = Cell("not decided", None, "inconclusive")
        return undecided if part.doubt else number_cell(getattr(part, side), part.unit, 6)

    columns: dict[str, Callable[[Any], Any]] = {
        **fields("part = name; value @unit 6"),
        "moves the pole by": lambda each: number_cell(0.01 * each.real, "1/s", 3),
    }
    if any(each.frequency for each in found.parts):  # else the rightmost pole is real
        columns["and"] = lambda each: number_cell(0.01 * each.frequency, "Hz", 3)
    if (stable := found.poles.stable) is not None:
        for side in ("below", "above"):
            title = f"{'unstable' if stable else 'stable'} {side}"
            columns[title] = partial(edge, side=side)
    note, most = PART_WORDS + EDGE_WORDS[stable], {"terminal": PARTS}
    return Table.of("", found.parts, columns, note, most)


def _sweep(found: Sweep, band: float) -> Iterator[Content]:
    edges, unit = found.edges, found.unit
    stable = ranges_words(found.stable_ranges, edges.low, edges.high, unit)
    if near := sorted((*edges.near, *found.doubtful)):
        ends = dict.fromkeys(quantity(near[k], unit) for k in (0, -1))
        stable += f"; not decided at {len(near)} values, {' to '.join(ends)}"
    crossings: dict[str, Column] = {
        "crossing": lambda edge: _with(edge.value, edge.bound, unit, 8),
        "frequency": frequency_cell,
        "unstable poles": lambda edge: f"{edge.below} → {edge.above}",
    }
    yield f"Stable: {stable}."
    yield Table.of("Crossings", found.edges.edges, crossings)
    points: dict[str, Column] = {
        **fields(f"{found.name} = value {unit or 'ratio'} 6"),
        "rightmost pole": lambda each: _with(each.real, each.bound, "1/s"),
        **fields("at = frequency Hz"),
        **_answers(band, over=True),
    }
    yield Table.of("Values", found.points, points, most={"terminal": POINTS})


def _varied(found: BoardCheck) -> Iterator[Section]:
    """Yield the worst corners and the yield, where there are tolerances."""
    study, share = found.corners, found.yields
    if study is None or share is None:
        return
    names = [out.node for out in found.circuit.outputs]
    yield Section("Worst cases", lambda: tolerance.tables(study, names), tolerance.SEARCHED)
    yield Section("Deviations", lambda: tolerance.deviations(study.corners), media="page")
    yield Section("Yield", f"{titled(share.sentence)}.")
    yield Section("Checks that do not pass", lambda: tolerance.failures(share))
    yield Section("Parts behind the spread", lambda: tolerance.parts_behind(share))
    yield Section("Strongest parts", lambda: tolerance.most_moved(share), media="page picture")
    yield Section("Spread", lambda: tolerance.spreads(share))
    yield Section("Histograms", lambda: tolerance.histograms(share), media="page")


def _response(found: BoardCheck) -> Chart | None:
    """Return the step response of the outputs, from the exact solution."""
    drawn = found.curve() if found.measurements.amplitude else None
    if drawn is None:
        return None
    time, values = drawn
    marks: list[Mark] = [
        Curve(time, values[:, k], out.node, SERIES[k % len(SERIES)])
        for k, out in enumerate(found.circuit.outputs)
    ]
    title, times = "Step response", [row.figures["settling_time"] for row in found.outputs]
    if not found.poles.stable:
        title += ": it grows" if found.poles.known_unstable else ": not decided"
    else:
        rests = (row.rest for row in found.outputs if row.rest is not None)
        marks += (Limit(rest, "y", colour="muted", line="dot") for rest in rests)
        if settled := [each for each in times if each is not None]:
            band = banded("settled", found.measurements.band)
            title += f": {band} at {quantity(max(settled), 's')}"
    summary = "Outputs over time after the step at t = 0; dotted: where they come to rest."
    return Chart(title, TIME, Axis("output", "V"), tuple(marks), summary)


def _witness(found: BoardCheck) -> str:
    check = next((each for each in found.checks if each.name == "ac_agrees"), None)
    if check is None or check.value is None:
        return "one witness: the state-space engine"
    off = f"differs by at most {check.value:.1e} at any node, beyond rounding"
    text = "agrees at every node within rounding" if check.value == 0.0 else off
    if check.outcome is Outcome.INCONCLUSIVE:
        text = "does not decide: rounding may hide a difference at an output"
    return f"ngspice's small signal (.ac) {text}"
