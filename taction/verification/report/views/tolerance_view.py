"""Tolerances: a yield with its histograms, and the worst corners."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from taction.system.array_types import Floats
from taction.system.charts import Axis, Band, Chart, Columns, Limit, Mark
from taction.system.quantities import counted, percent, spaced
from taction.verification.report.blocks import Content, Notes, Page, Section, Table
from taction.verification.report.texts import Cell, Column, fields, figure, number_cell, titled
from taction.verification.report.views.answer_view import origin_section
from taction.verification.studies.tolerance.corners import Corner, CornerStudy
from taction.verification.studies.tolerance.montecarlo import CHECK_OF, Quantity, YieldReport

BINS = 40  # of a histogram, at most
FAR = 1.5  # times the range of the values: a limit farther away is not drawn
SAME = 1e-9  # relative: values that are one value
Limits = tuple[float | None, float | None]  # the least and the largest accepted value
COUNTED = "Each column counts the samples in a range of values"
PARTS = 12  # of a terminal, and of a chart
MOVED = (
    "The square of the correlation over the samples is the share of the variance that the deviation"
    " of one part explains alone. With + the quantity grows with the part. Left out: samples"
    " without a value, and parts whose correlation is within four standard errors, each 1 over the"
    " root of the number of samples."
)
NOTHING = "no part stands out by four standard errors, or fewer than 30 samples have a value."


def yield_view(result: YieldReport) -> Page:
    """Return the page of a yield."""
    origin = (("seed", str(result.seed)), ("samples", str(result.samples)))
    text, shown = result.sentence, "terminal page notebook"
    return Page(
        title=result.name,
        command="taction yield montecarlo",
        outcome="" if result.min_yield is None else result.outcome,
        summary=f"{text[:1].upper()}{text[1:]}.",
        sections=(
            Section("Checks that do not pass", tuple(failures(result)), media=shown),
            Section("Parts behind the spread", parts_behind(result), media=shown),
            Section("Strongest parts", lambda: most_moved(result), media="page picture"),
            Section("Quantities", spreads(result), media=shown),
            Section("Histograms", lambda: histograms(result), media="page picture"),
            origin_section(result.scene, origin),
        ),
    )


def failures(result: YieldReport) -> Iterator[Content]:
    """Yield the checks that do not pass, and the samples without a verdict."""
    columns = {
        "check": lambda each: spaced(each[0]),
        "samples": lambda each: each[1],
        "of all": lambda each: percent(each[1] / result.samples, 4),
    }
    yield Table.of("Checks that do not pass", result.failures.items(), columns)
    if result.without_verdict:
        text = f"{counted(result.without_verdict, 'sample')} without a verdict count as failed."
        lines = (f"{count} samples: {reason}" for reason, count in result.reasons.items())
        yield Notes("Samples without a verdict", (text, *lines))


def _beyond(values: Floats, limits: Limits) -> Any:
    least, most = limits
    low, high = -math.inf if least is None else least, math.inf if most is None else most
    return (values < low) | (values > high)


def spreads(result: YieldReport) -> Table:
    """Return the spread of each quantity."""
    columns = {
        **fields("quantity = title; at_least @unit; at_most @unit"),
        **fields("5 % = low @unit; median @unit; 95 % = high @unit"),
        "no value": lambda each: _values(result, each)[1],
    }
    shown = result.quantities if result.samples else ()
    texts = ((each.title, _values(result, each)[2]) for each in shown)
    notes = (f"{titled(title)}: {text}." for title, text in texts if text)
    note = " ".join(("5 % and 95 %: percentiles of the samples.", *notes))
    return Table.of("Quantities", shown, columns, note)


def _values(result: YieldReport, spread: Quantity) -> tuple[Floats, int, str]:
    """Return the values of a quantity, how many samples have none, and whether these pass."""
    every = [(each, None if each.lost else each.value(spread.name)) for each in result.boards]
    known = [value for _, value in every if value is not None and math.isfinite(value)]
    without = [each for each, value in every if value is None or not math.isfinite(value)]
    count, lost = len(without), sum(each.outcome != "pass" for each in without)
    text = f"{counted(count, 'sample')} without a value" if count else ""
    if lost:
        text += f", {'' if lost == count else f'{lost} of them '}counted as failing"
    values, least = np.array(known, dtype=np.float64), spread.at_least or 0.0
    if spread.name == "margin" and bool((np.abs(values - least) <= SAME * least).any()):
        end = f"{least:g} means {least:g} or more, where the search ends"
        text = f"{text}; {end}" if text else end
    return values, count, text


def _costliest(result: YieldReport) -> list[Quantity]:
    """Return the quantities, those first whose check costs most yield, those without limit last."""
    return sorted(result.quantities, key=lambda each: (not _limits(each), -_lost(result, each)))


def _lost(result: YieldReport, spread: Quantity) -> int:
    """Return how many samples do not pass the check of a quantity."""
    return result.failures.get(CHECK_OF.get(spread.name, spread.name), 0)


def _moved(spread: Quantity) -> str:
    """Return what the parts of a quantity move."""
    of = f", error of channel {spread.channel}" if spread.channel else ""
    return f"{spread.title}{of}"


def parts_behind(result: YieldReport) -> Table:
    """Return the parts that move the quantities with a limit."""
    columns: dict[str, Column] = {
        "quantity": lambda each: _moved(each[0]),
        "not passed": lambda each: percent(_lost(result, each[0]) / result.samples, 4),
        "part": lambda each: each[1],
        "correlation": lambda each: Cell(f"{each[2]:+.2f}", each[2]),
        "of the variance": lambda each: Cell(percent(each[2] ** 2, 2), each[2] ** 2),
    }
    limited = [each for each in _costliest(result) if _limits(each)]
    rows = [(each, part, size) for each in limited for part, size in each.parts.items()]
    title = "What moves the limited quantities"
    return Table.of(title, rows, columns, MOVED, {"terminal": PARTS, "notebook": PARTS})


def most_moved(result: YieldReport) -> Iterator[Content]:
    """Yield the chart of the parts that move the quantity whose check costs most yield."""
    for spread in _costliest(result)[:1]:
        parts = dict([*spread.parts.items()][:PARTS])
        if not parts:
            yield Notes("Parts", (f"{titled(_moved(spread))}: {NOTHING}",))
            continue
        places, shares = np.arange(float(len(parts))), np.square([*parts.values()])
        names = tuple(f"{'-' if size < 0.0 else '+'}{part}" for part, size in parts.items())
        looks, widths = ("pass",) * len(parts), np.full(len(parts), 0.7)
        first = f"{next(iter(parts))} explains {percent(float(shares[0]), 2)} of the variance"
        yield Chart(
            f"Parts behind {_moved(spread)}: {first}",
            Axis("", scale="names", names=names),
            Axis("share of the variance (%)"),
            (Columns(places, 100.0 * shares, widths, looks),),
            "With + the quantity grows with the part.",
            height=300,
        )


def histograms(result: YieldReport) -> Iterator[Content]:
    """Yield a histogram of each quantity, those first whose check costs most yield."""
    for spread in _costliest(result):
        title, (values, count, text) = titled(spread.title), _values(result, spread)
        if len(values) and np.ptp(values) > SAME * np.abs(values).max():
            yield _histogram(title, spread, values, text)
            continue
        if len(values):
            same = figure(float(values[0]), spread.unit)
            every = "every sample has" if not count else f"{len(values)} samples have"
            text = "; ".join(filter(None, (f"{every} {same}", text)))
        yield Notes(title, (f"{title}: {text}.",) if text else ())


def _histogram(title: str, spread: Quantity, values: Floats, text: str) -> Chart:
    """Return the histogram of values, with the limits near them; `text`: what has none."""
    unit, both = spread.unit, (spread.at_least, spread.at_most)
    limits = [limit for limit in both if limit is not None]
    edges = np.histogram_bin_edges(values, bins=min(BINS, 4 + math.isqrt(len(values))))
    width, middles = float(edges[1] - edges[0]), 0.5 * (edges[1:] + edges[:-1])
    low, high = float(edges[0]) - width, float(edges[-1]) + width
    reach = FAR * (high - low)
    near = [limit for limit in limits if low - reach <= limit <= high + reach]
    shown = min([low, *near]) - width, max([high, *near]) + width
    counts = np.histogram(values, bins=edges)[0]
    looks = tuple("fail" if out else "pass" for out in _beyond(middles, both))
    marks: list[Mark] = [Columns(middles, counts, np.diff(edges), looks)]
    marks += (Limit(limit, "x", "limit") for limit in near)
    if spread.at_most is not None:
        marks.append(Band(min(spread.at_most, shown[1]), shown[1], "x", colour="fail"))
    if spread.at_least is not None:
        marks.append(Band(shown[0], max(spread.at_least, shown[0]), "x", colour="fail"))
    message = "no limit"
    if limits:
        beyond, texts = _beyond(values, both), " and ".join(figure(each, unit) for each in limits)
        share = percent(float(beyond.mean()))
        message = f"{int(beyond.sum())} of {len(values)} samples ({share}) beyond {texts}"
    message += f", {text}" * bool(text)
    x, y = Axis(spread.title, unit, limits=shown), Axis("samples", whole=True)
    hatched = "; hatched: beyond the limit" * bool(limits)
    return Chart(f"{title}: {message}", x, y, tuple(marks), f"{COUNTED}{hatched}.")


WORST = ("fail", "inconclusive", "pass")
LISTED = 500  # rows of a page
SEARCHED = (
    "Every component that moves a quantity at an end of its tolerance, as the slopes at the nominal"
    " board make it worst; where these miss its change by more than 10 %, also by the slopes at the"
    " corners. No other combination of the ends is verified."
)


def corner_view(study: CornerStudy) -> Page:
    """Return the page of the corners of a scene."""
    corners = study.corners
    outcomes = [corner.result.outcome for corner in corners]
    outcome = next((each for each in WORST if each in outcomes), "")
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in WORST if each in outcomes)
    return Page(
        title=study.name,
        command="taction yield corners",
        outcome=outcome,
        summary=f"{counted(len(corners), 'corner')}: {counts}.",
        lines=(SEARCHED,) * any(corner.quantity for corner in corners),
        sections=(
            Section("Corners", tuple(tables(study))),
            Section("Deviations", lambda: deviations(corners), media="page"),
            origin_section(study.scene),
        ),
    )


def tables(study: CornerStudy, names: Sequence[str] = ()) -> Iterator[Content]:
    """Yield the corners with their values, why they do not pass, and the errors of the channels.

    `names` are those of the channels.
    """
    reported, corners = study.quantities, study.corners
    columns: dict[str, Column] = {"corner": _name, "outcome": "result.outcome outcome"}
    columns |= {each.title: partial(_quantity, each) for each in reported}
    yield Table.of("Corners", corners, columns, "; ".join(filter(None, map(_limits, reported))))
    yield Notes("Why, and most moved by", tuple(filter(None, map(_remark, corners))))
    known = [each for each in corners if each.result.errors]
    columns = {"channel": lambda n: names[n] if names else f"u{n + 1}"}
    columns |= {_name(each): partial(_error, each) for each in known}
    channels = range(len(known[0].result.errors) if known else 0)
    yield Table.of("Errors at rest, by channel", channels, columns)


def _error(corner: Corner, channel: int) -> Cell:
    return number_cell(corner.result.errors[channel], "step", 3)


def deviations(corners: Sequence[Corner]) -> Table:
    """Return to which end of its tolerance every part goes in each corner."""
    moved = [corner for corner in corners if corner.deviations]
    columns: dict[str, Column] = {"part": str}
    columns |= {_name(each): partial(_deviation, each) for each in moved}
    parts = dict.fromkeys(part for each in moved for part in each.deviations)
    return Table.of("Deviations, in tolerances", parts, columns, "", {"page": LISTED})


def _deviation(corner: Corner, part: str) -> Cell | None:
    value = corner.deviations.get(part)
    return None if value is None else Cell(f"{value:+g}", value)


def _limits(quantity: Quantity) -> str:
    """Return the limits of a quantity in words; empty without any."""
    ends = zip(("at least", "at most"), (quantity.at_least, quantity.at_most), strict=True)
    words = [f"{word} {figure(end, quantity.unit)}" for word, end in ends if end is not None]
    return f"{quantity.title} {' and '.join(words)}" if words else ""


def _quantity(quantity: Quantity, corner: Corner) -> Cell:
    """Return the value of a corner, marked where it is beyond a limit."""
    cell = number_cell(corner.result.value(quantity.name), quantity.unit)
    limits = quantity.at_least, quantity.at_most
    beyond = cell.number is not None and _beyond(np.array(cell.number), limits)
    return replace(cell, outcome="fail" if beyond else "")


def _name(corner: Corner) -> str:
    """Return the name of a corner in words, and a user's own name unchanged."""
    return spaced(corner.name) if corner.quantity else corner.name


def _remark(corner: Corner) -> str:
    """Return why a corner does not pass, and the parts behind it."""
    failed, largest = corner.result.record.failed, " ".join(corner.largest)
    verb = "not decided: " if corner.result.undecided else "fails "
    remarks = (
        corner.result.lost,
        f"{verb}{', '.join(map(spaced, failed))}" if failed else "",
        f"most moved by {largest}" if largest else "",
    )
    return f"{_name(corner)}: {'; '.join(filter(None, remarks))}" if any(remarks) else ""
