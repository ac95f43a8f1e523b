"""Tolerances: a yield with its histograms and causes, and the worst corners."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from taction.system.array_types import Floats
from taction.system.charts import Axis, Band, Chart, Columns, Limit, Mark, Text
from taction.verification.report.blocks import Bar, Bars, Content, Notes, Page, Section, Table
from taction.verification.report.texts import (
    Cell,
    Column,
    counted,
    fields,
    figure,
    number_cell,
    percent,
    spaced,
    titled,
)
from taction.verification.report.views.origin_view import origin_section
from taction.verification.studies.tolerance.corners import Corner, CornerStudy
from taction.verification.studies.tolerance.montecarlo import (
    CHECK_OF,
    QuantitySpread,
    YieldReport,
)
from taction.verification.studies.tolerance.varied_board import BoardSample, Quantity

BINS = 40  # of a histogram, at most
CULPRITS = 12  # parts of a chart
SHOWN = 10  # sensitivities in a terminal
FAR = 1.5  # times the range of the values: a limit farther away is an arrow
SAME = 1e-9  # relative: values that are one value
Limits = tuple[float | None, float | None]  # the least and the largest accepted value
COUNTED = "Each column counts the samples in a range of values; hatched: beyond the limit."
CULPRIT = (
    "Share of a part in the variance of a quantity with a limit; the quantity whose check costs"
    " most yield comes first. Solid with +: the quantity grows with the part; hatched with −: it"
    " falls."
)


def yield_view(result: YieldReport) -> Page:
    """Return the page of a yield."""
    rows = (("seed", str(result.seed)), ("samples", str(result.samples)))
    text, shown = result.sentence, "terminal page notebook"
    return Page(
        title=result.name,
        command="taction yield montecarlo",
        summary=f"{text[:1].upper()}{text[1:]}. {_worst(result)}".rstrip(),
        sections=(
            Section("Checks that do not pass", tuple(failures(result)), media=shown),
            Section("What costs yield", lambda: _culprits(result), media="page picture"),
            Section("Quantities", spreads(result), media=shown),
            Section("Histograms", lambda: histograms(result), media="page picture"),
            Section("Causes", causes(result), media=shown),
            origin_section(result.scene, rows),
        ),
    )


def _worst(result: YieldReport) -> str:
    """Return which check costs most yield, and which part moves it most; empty without losses."""
    worst = next(iter(result.failures), "")
    if not (worst and result.samples):
        return ""
    share = percent(result.failures[worst] / result.samples, 4)
    text = f"{share} of the boards do not pass the check of the {spaced(worst)}"
    own = (each for each in result.sensitivities if _check(each.quantity) == worst)
    if (first := next(own, None)) is None:
        return f"{text}."
    place = "" if first.channel is None else f" in channel {first.channel}"
    return (
        f"{text}; {first.parameter} moves it most: it is behind {100 * first.correlation**2:.0f} %"
        f" of the variance of the {spaced(first.quantity)}{place}."
    )


def _check(quantity: str) -> str:
    """Return the check that a quantity belongs to."""
    return CHECK_OF.get(quantity, quantity)


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


def spread_bar(
    name: str, unit: str, values: Mapping[str, float], limits: Limits, missing: str = ""
) -> Bar:
    """Return the spread of a quantity against its limits; the end nearest to one is the bar.

    `values` are the least, the typical and the largest one, finite, by their names on the page;
    `missing` says which values the quantity lacks: they do not pass.
    """
    low, high = min(values.values()), max(values.values())
    least, most = limits
    shares, limited = [], []
    if least is not None:
        shares += [least / low] if low > 0.0 else []
        limited.append(f"at least {figure(least, unit)}")
    if most is not None:
        shares += [high / most] if most > 0.0 else []
        limited.append(f"at most {figure(most, unit)}")
    fails = bool(_beyond(np.array([low, high]), limits).any()) or bool(missing)
    return Bar(
        name=spaced(name),
        outcome=("fail" if fails else "pass") if limited else "",
        share=max(shares, default=None),
        doubt=0.0,
        value=", ".join(f"{title} {figure(value, unit)}" for title, value in values.items()),
        limit=", ".join(limited),
        reason=missing,
    )


def _beyond(values: Floats, limits: Limits) -> np.ndarray:
    least, most = limits
    low, high = -math.inf if least is None else least, math.inf if most is None else most
    return np.asarray((values < low) | (values > high))


def spreads(result: YieldReport) -> Table:
    """Return the spread of each quantity."""
    columns = {
        **fields("quantity = title; at_least @unit; at_most @unit"),
        **fields("5 % = low @unit; median @unit; 95 % = high @unit"),
        "no value": lambda each: _gaps(result, each)[0],
    }
    shown = result.quantities if result.samples else ()
    notes = (f"{titled(each.title)}: {text}." for each in shown if (text := _gaps(result, each)[1]))
    note = " ".join(("5 % and 95 %: percentiles of the samples.", *notes))
    return Table.of("Quantities", shown, columns, note)


def _gaps(result: YieldReport, spread: QuantitySpread) -> tuple[int, str]:
    """Return how many samples have no value of a quantity, and in words whether they pass."""
    without = [each for each in result.boards if _number(each, spread) is None]
    count, lost = len(without), sum(each.outcome != "pass" for each in without)
    text = f"{counted(count, 'sample')} without a value" if count else ""
    if lost:
        text += f", {'' if lost == count else f'{lost} of them '}counted as failing"
    return count, text


def _number(sample: BoardSample, spread: QuantitySpread) -> float | None:
    """Return the finite value of a quantity; None without one, or without a verdict."""
    value = None if sample.lost else sample.value(spread.name)
    return value if value is not None and math.isfinite(value) else None


def histograms(result: YieldReport) -> Iterator[Content]:
    """Yield a histogram of each quantity, those first whose check costs most yield."""

    def place(spread: QuantitySpread) -> tuple[bool, int]:
        unlimited = spread.at_least is None and spread.at_most is None
        return unlimited, -result.failures.get(_check(spread.name), 0)

    for spread in sorted(result.quantities, key=place):
        found, title = (_number(each, spread) for each in result.boards), titled(spread.title)
        values = np.array([value for value in found if value is not None], dtype=np.float64)
        count, text = _gaps(result, spread)
        if len(values) and np.ptp(values) > SAME * np.abs(values).max():
            yield _histogram(title, spread, values, text)
            continue
        if len(values):
            same = figure(float(values[0]), spread.unit)
            every = "every sample has" if not count else f"{len(values)} samples have"
            text = "; ".join(filter(None, (f"{every} {same}", text)))
        yield Notes(title, (f"{title}: {text}.",) if text else ())


def _histogram(title: str, spread: QuantitySpread, values: Floats, text: str) -> Chart:
    """Return the histogram of values; a limit far away is an arrow, `text` what has none."""
    unit, limits = spread.unit, [x for x in (spread.at_least, spread.at_most) if x is not None]
    beyond, edges = _beyond(values, (spread.at_least, spread.at_most)), _edges(values, limits)
    width = float(edges[1] - edges[0])
    low, high = float(edges[0]) - width, float(edges[-1]) + width
    reach = FAR * (high - low)
    near = [limit for limit in limits if low - reach <= limit <= high + reach]
    shown = min([low, *near]) - width, max([high, *near]) + width
    middles, counts = 0.5 * (edges[1:] + edges[:-1]), np.histogram(values, bins=edges)[0]
    looks = tuple(
        "fail" if out else "pass" for out in _beyond(middles, (spread.at_least, spread.at_most))
    )
    hover = tuple(f"{count} samples" for count in counts.tolist())
    bars = Columns(middles, counts, "x", np.diff(edges), looks, hover=hover)
    marks: list[Mark] = [bars, *(Limit(limit, "x", "limit") for limit in near)]
    if spread.at_most is not None:
        marks.append(Band(min(spread.at_most, shown[1]), shown[1], "x", colour="fail"))
        if spread.at_most not in near:
            marks.append(Text("limit →", None, None, ("left", "below")))
    if spread.at_least is not None:
        marks.append(Band(shown[0], max(spread.at_least, shown[0]), "x", colour="fail"))
        if spread.at_least not in near:
            marks.append(Text("← limit", None, None, ("right", "below")))
    message = "no limit"
    if limits:
        share = percent(float(beyond.mean()))
        texts = " and ".join(figure(limit, unit) for limit in limits)
        message = f"{int(beyond.sum())} of {len(values)} samples ({share}) beyond {texts}"
    message += f", {text}" * bool(text)
    x, y = Axis(spread.title, unit, limits=shown), Axis("samples", whole=True)
    return Chart(f"{title}: {message}", x, y, tuple(marks), COUNTED)


def _edges(values: Floats, limits: list[float]) -> Floats:
    """Return the edges of the bins; a limit among the values is an edge."""
    edges = np.histogram_bin_edges(values, bins=min(BINS, 4 + math.isqrt(len(values))))
    inside = [limit for limit in limits if edges[0] < limit < edges[-1]]
    if not inside:
        return np.asarray(edges, dtype=np.float64)
    width = float(edges[1] - edges[0])
    before = math.ceil((inside[0] - edges[0]) / width)
    after = math.ceil((edges[-1] - inside[0]) / width)
    return np.asarray(inside[0] + width * np.arange(-before, after + 1))


def _culprits(result: YieldReport) -> Content:
    shown = result.sensitivities[:CULPRITS]
    if not shown:
        return _no_causes(result)
    shares = [100.0 * each.correlation**2 for each in shown]
    signs = ["+" if each.correlation > 0.0 else "−" for each in shown]
    looks = tuple("pass" if sign == "+" else "fail" for sign in signs)
    names = tuple(
        f"{each.parameter}, {spaced(each.quantity)}: {sign} {share:.0f} %"
        for each, sign, share in zip(shown, signs, shares, strict=True)
    )
    return Chart(
        "Parts behind the lost yield",
        Axis("share of the variance (%)"),
        Axis(scale="names", names=names, reverse=True),
        (Columns(np.arange(float(len(shown))), shares, "y", looks=looks),),
        CULPRIT,
    )


def _no_causes(result: YieldReport) -> Notes:
    text = "No sample fails a check: no part costs yield."
    if result.failures:
        text = (
            "No part's influence on a quantity whose check costs yield stands out of the scatter of"
            f" these {counted(result.samples, 'sample')}."
        )
    elif result.passed < result.samples:
        text = "The lost samples have no verdict: no part is known to cost yield."
    return Notes("Parts behind the lost yield", (text,) if result.samples else ())


def causes(result: YieldReport) -> Content:
    """Return the parts behind the spread of what costs yield, or why none is listed."""
    if not result.sensitivities:
        return _no_causes(result)
    columns: dict[str, Column] = {
        "quantity": lambda each: spaced(each.quantity),
        "channel": lambda each: "" if each.channel is None else each.channel,
        "lost": lambda each: Cell(percent(each.lost, 4), each.lost),
        "part": "parameter",
        "correlation": lambda each: Cell(
            f"{each.correlation:+.2f} ± {each.standard_error:.2f}", each.correlation
        ),
        "variance": lambda each: Cell(f"{100 * each.correlation**2:.0f} %", each.correlation**2),
    }
    few = {"terminal": SHOWN, "notebook": SHOWN}
    note = "lost: of the yield; variance: the share that the part explains."
    return Table.of("Causes, by lost yield", result.sensitivities, columns, note, most=few)


WORST = ("fail", "inconclusive", "pass")
RANGES = "The bar is the part of the limit that the worst corner uses; typical: the nominal board."
DEVIATIONS = 200  # deviations in a table
DIRECTIONS = 4  # worst-case directions in a terminal


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
        lines=("Every component at an end of its tolerance, as it makes a quantity worst.",),
        sections=(
            Section("Least, typical and largest values", lambda: ranges(study)),
            Section("Corners", tuple(tables(study.quantities, corners)), media="terminal page"),
            Section("Channels at rest", directions(study), media="terminal page"),
            Section("Deviations", _deviations(corners)),
            origin_section(study.scene),
        ),
    )


def ranges(study: CornerStudy) -> Iterator[Content]:
    """Yield the least, typical and largest values of the corners, against the limits."""
    rows = []
    for each in study.quantities:
        found = [corner.result.value(each.name) for corner in study.corners]
        if values := [value for value in found if value is not None and math.isfinite(value)]:
            nominal = found[0] if found[0] in values else values[0]
            shown = {"least": min(values), "typical": nominal, "largest": max(values)}
            lost = len(found) - len(values)
            missing = f"{lost} corners without a value" if lost else ""
            rows.append(spread_bar(each.title, each.unit, shown, each.limits, missing))
    yield Bars("", tuple(rows), RANGES)


def tables(reported: Sequence[Quantity], corners: Sequence[Corner]) -> Iterator[Content]:
    """Yield the corners with their values, and why they do not pass."""
    columns: dict[str, Column] = {"corner": _name, "outcome": "result.outcome outcome"}
    columns |= {each.title: partial(_quantity, each) for each in reported}
    yield Table.of("Corners", corners, columns)
    yield Notes("Why, and most moved by", tuple(filter(None, map(_remark, corners))))


def _quantity(quantity: Quantity, corner: Corner) -> Cell:
    return number_cell(corner.result.value(quantity.name), quantity.unit)


def _name(corner: Corner) -> str:
    """Return the name of a corner in words, and a user's own name unchanged."""
    return spaced(corner.name) if corner.quantity else corner.name


def _remark(corner: Corner) -> str:
    """Return why a corner does not pass, and the parts behind it."""
    failed, largest = corner.result.failed, " ".join(corner.largest)
    verb = "not decided: " if corner.result.undecided else "fails "
    remarks = (
        corner.result.lost,
        f"{verb}{', '.join(map(spaced, failed))}" if failed else "",
        f"most moved by {largest}" if largest else "",
    )
    return f"{_name(corner)}: {'; '.join(filter(None, remarks))}" if any(remarks) else ""


def directions(study: CornerStudy, names: Sequence[str] = ()) -> Table:
    """Return the errors of the channels at rest, the largest first; `names` are those of decks."""
    columns = {
        "channel": lambda each: Cell(
            names[each.channel - 1] if names else f"u{each.channel}", each.channel
        ),
        "side of the reference": lambda each: "above" if each.sign > 0 else "below",
        **fields("first order = predicted step; solved step"),
        "most moved by": lambda each: " ".join(each.largest),
    }
    note, title = "Worst-case errors at rest, from the signs of the sensitivities.", "Largest error"
    most, more = {"terminal": DIRECTIONS}, "{} smaller ones: --json."
    return Table.of(f"{title} of each channel at rest", study.directions, columns, note, most, more)


def _deviations(corners: Sequence[Corner]) -> Table:
    """Return the deviations, in tolerances, with a column for each corner."""
    moved = [corner for corner in corners if corner.deviations]
    names = list(dict.fromkeys(name for corner in moved for name in corner.deviations))
    columns: dict[str, Column] = {"part": str}
    columns |= {_name(corner): partial(_deviation, corner) for corner in moved}
    note, most = "In tolerances of the part.", {"page": DEVIATIONS}
    return Table.of("Deviations", names, columns, note, most, "{} more parts: --json.")


def _deviation(corner: Corner, part: str) -> Cell | None:
    value = corner.deviations.get(part)
    return None if value is None else Cell(f"{value:+g}", value)
