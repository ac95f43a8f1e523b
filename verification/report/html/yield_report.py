"""The report of a yield: the interval, histograms with limits, and the parts behind the spread."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.html.blocks import (
    Block,
    Cell,
    Facts,
    Notes,
    Picture,
    Range,
    Ranges,
    Report,
    Section,
    Table,
    View,
)
from taction.verification.report.html.pictures import HATCH, area, axis, line
from taction.verification.report.html.ranges import is_beyond, value_range
from taction.verification.report.html.sections.origin import origin_section
from taction.verification.report.html.texts import counted, figure, number_cell, percent, titled
from taction.verification.report.tables import spaced
from taction.verification.report.tolerance.tables import remedy_text
from taction.verification.studies.tolerance.varied_board import BoardSample
from taction.verification.studies.tolerance.yield_report import Spread, YieldReport

BINS = 40  # of a histogram
CULPRITS = 12  # parts of a picture
UNITS = {"s": "s", "1/s": "/s", "step": "", "ratio": ""}


def yield_report(
    scene: Scene, result: YieldReport, samples: Sequence[BoardSample], seed: int
) -> Report:
    """Return the report of a yield.

    Parameters
    ----------
    samples : sequence of BoardSample
        The samples that `result` summarises.
    """
    low, high = percent(result.low), percent(result.high)
    return Report(
        title=scene.name,
        command="taction montecarlo",
        outcome="",
        summary=f"Yield {percent(result.fraction)}, 95 % interval {low} to {high}."
        if result.samples
        else "No sample, no yield.",
        lines=(f"{result.passed} of {result.samples} boards pass; seed {seed}.",),
        sections=(
            Section("Yield", tuple(_overview(result))),
            Section("Spread and limits", tuple(_spreads(result))),
            Section("Histograms", tuple(_histograms(result, samples))),
            Section("Culprits", tuple(_culprits(result))),
            origin_section(scene, (("seed", str(seed)), ("samples", str(result.samples)))),
        ),
    )


def _overview(result: YieldReport) -> Iterator[Block]:
    if not result.samples:
        return
    texts = (
        f"95 % interval {percent(result.low)} to {percent(result.high)}",
        f"estimate {percent(result.fraction)}",
    )
    row = Range("yield, from 0 to 100 %", result.low, result.fraction, result.high, (), "", texts)
    yield Ranges("", (row,))
    rows = (
        ("samples", str(result.samples)),
        ("pass", str(result.passed)),
        ("without a verdict, counted as failed", str(result.without_verdict)),
    )
    yield Facts("", rows)
    if result.failures:
        cells = tuple(
            (Cell(spaced(name)), Cell(str(count), count), Cell(percent(count / result.samples)))
            for name, count in result.failures.items()
        )
        yield Table("Checks that do not pass", ("check", "samples", "of all"), cells)
    if result.remedy is not None:
        yield Notes("What to buy better", (remedy_text(result.remedy),))
    if result.reasons:
        lines = tuple(f"{count} samples: {reason}" for reason, count in result.reasons.items())
        yield Notes("Why there is no verdict", lines)


def _spreads(result: YieldReport) -> Iterator[Block]:
    rows = [row for spread in result.quantities if (row := _range(spread)) is not None]
    if rows:
        note = (
            "The bar goes from the 5th to the 95th percentile, the line in it is the median, the"
            " black line the limit. Hatched: beyond the limit."
        )
        yield Ranges(
            "5th percentile, median and 95th percentile against the limits", tuple(rows), note
        )
    titles = (
        "quantity",
        "at least",
        "at most",
        "5th percentile",
        "median",
        "95th percentile",
        "missing",
    )
    cells = tuple(
        (
            Cell(spaced(each.name)),
            *(
                number_cell(value, each.unit)
                for value in (each.at_least, each.at_most, each.low, each.median, each.high)
            ),
            Cell(str(each.missing), each.missing),
        )
        for each in result.quantities
    )
    yield Table("Quantities", titles, cells)


def _range(spread: Spread) -> Range | None:
    values = {"5th percentile": spread.low, "median": spread.median, "95th": spread.high}
    if not all(map(math.isfinite, values.values())):
        return None
    return value_range(spread.name, spread.unit, values, (spread.at_least, spread.at_most))


def _histograms(result: YieldReport, samples: Sequence[BoardSample]) -> Iterator[Block]:
    for spread in result.quantities:
        found = [sample.value(spread.name) for sample in samples if not sample.lost]
        values = np.array([value for value in found if value is not None], dtype=np.float64)
        values = values[np.isfinite(values)]
        if len(values) > 1:
            yield _histogram(spread, values)


def _histogram(spread: Spread, values: np.ndarray[Any, Any]) -> Picture:
    factor, unit = (100.0, "%") if spread.unit == "step" else (1.0, UNITS.get(spread.unit, ""))
    limits = [limit for limit in (spread.at_least, spread.at_most) if limit is not None]
    inside = np.array(
        [not is_beyond(value, (spread.at_least, spread.at_most)) for value in values.tolist()]
    )
    edges = np.histogram_bin_edges(factor * values, bins=min(BINS, 1 + int(len(values) ** 0.5 * 2)))
    width, middle = float(edges[1] - edges[0]), 0.5 * (edges[1:] + edges[:-1])
    data = []
    looks: tuple[tuple[str, Any, str, dict[str, Any]], ...] = (
        ("within the limit" if limits else "samples", inside, "--pass", {}),
        ("beyond the limit", ~inside, "--fail-fill", HATCH),
    )
    for name, chosen, colour, pattern in looks:
        if not chosen.any():
            continue
        counts, _ = np.histogram(factor * values[chosen], bins=edges)
        data.append(
            {"type": "bar", "name": name, "x": middle.tolist(), "y": counts.tolist(),
             "width": width, "marker": {"color": colour, "pattern": pattern},
             "hovertemplate": f"%{{x:.4s}}{unit}: %{{y}} samples<extra>{name}</extra>"}
        )  # fmt: skip
    shapes = [line(factor * limit, None, "--ink", dash="dash") for limit in limits]
    ends = [float(edges[0]), float(edges[-1]), *(factor * limit for limit in limits)]
    first, last = min(ends) - width, max(ends) + width
    if spread.at_most is not None:
        shapes.append(area(factor * spread.at_most, last, across="x", colour="--fail-soft"))
    if spread.at_least is not None:
        shapes.append(area(first, factor * spread.at_least, across="x", colour="--fail-soft"))
    views = (
        View("samples", {"xaxis.range": [float(edges[0]) - width, float(edges[-1]) + width]}),
        View("with the limits", {"xaxis.range": [first, last]}),
    )
    layout = {
        "xaxis": axis(spaced(spread.name), unit) | ({"tickformat": ".4~g"} if unit == "%" else {}),
        "yaxis": axis("samples"),
        "shapes": shapes,
        "barmode": "stack",
        "bargap": 0.02,
        "showlegend": True,
    }
    texts = " and ".join(figure(limit, spread.unit) for limit in limits)
    result = (
        f"{int((~inside).sum())} of {len(values)} samples beyond {texts}" if limits else "no limit"
    )
    if spread.missing:
        result += f", {counted(spread.missing, 'sample')} without a value"
    summary = (
        f"{len(values)} samples from {figure(float(values.min()), spread.unit)} to"
        f" {figure(float(values.max()), spread.unit)}; {result}."
    )
    spec = {"data": data, "layout": layout}
    return Picture(titled(spread.name), spec, summary, 280, views, result=result)


def _culprits(result: YieldReport) -> Iterator[Block]:
    if not result.sensitivities:
        text = "No part has an influence that stands out of the scatter of these samples."
        yield Notes("", (text,))
        return
    shown = result.sensitivities[:CULPRITS]
    names = [f"{spaced(s.quantity)}: {s.parameter}" for s in shown]
    shares = [100.0 * s.correlation**2 for s in shown]
    signs = ["+" if s.correlation > 0 else "−" for s in shown]
    data = [
        {"type": "bar", "orientation": "h", "y": names, "x": shares,
         "marker": {"color": ["--pass" if sign == "+" else "--fail-fill" for sign in signs],
                    "pattern": HATCH | {"shape": ["" if sign == "+" else "/" for sign in signs]}},
         "text": [f"{sign} {share:.0f} %" for sign, share in zip(signs, shares, strict=True)],
         "textposition": "outside", "cliponaxis": False,
         "hovertemplate": "%{y}: %{text} of the variance<extra></extra>"}
    ]  # fmt: skip
    layout = {
        "xaxis": axis("share of the variance (%)", range=[0, 1.2 * max(shares)]),
        "yaxis": {"autorange": "reversed"},
        "margin": {"l": 60, "r": 40, "t": 8, "b": 44},
    }
    summary = (
        "Parts with the largest share of the variance of a quantity. Solid with +: the quantity"
        " grows with the part; hatched with −: it falls."
    )
    height = 110 + 26 * len(shown)
    yield Picture("Shares", {"data": data, "layout": layout}, summary, height, zoom=False)
    rows = tuple(
        (
            Cell(spaced(s.quantity) + ("" if s.channel is None else f", channel {s.channel}")),
            Cell(s.parameter),
            Cell(spaced(s.kind)),
            Cell(f"{s.correlation:+.2f} ± {s.standard_error:.2f}", s.correlation),
            Cell(f"{100 * s.correlation**2:.0f} %", s.correlation**2),
        )
        for s in result.sensitivities
    )
    titles = ("quantity", "part", "kind", "correlation", "of the variance")
    yield Table("Sensitivities", titles, rows)
