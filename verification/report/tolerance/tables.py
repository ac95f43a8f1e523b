"""Yields and corners as tables for people."""

from __future__ import annotations

import math

from rich.console import Console

from taction.system.quantities import UNITS
from taction.verification.report.fitted_table import FittedTable
from taction.verification.report.tables import make_table, spaced, value_text
from taction.verification.studies.tolerance.corners import Corner
from taction.verification.studies.tolerance.remedy import Remedy
from taction.verification.studies.tolerance.steady_directions import Direction
from taction.verification.studies.tolerance.varied_board import Quantity
from taction.verification.studies.tolerance.yield_report import Spread, YieldReport

TOP = 10  # sensitivities in the table; JSON has them all
SHOWN = 4  # worst-case directions in the table; JSON has them all
DIRECTION = ("channel", "sign", "predicted", "solved", "largest", "deviations")  # in JSON
REASONS = 3  # for samples without verdict, the most frequent first


def print_yield(report: YieldReport, seed: int, console: Console) -> None:
    """Print the yield with its interval, the failed checks, the quantities and sensitivities."""
    if not report.samples:
        console.print("no sample: no yield")
        return
    console.print(
        f"yield {_percent(report.fraction)} ({report.passed} of {report.samples}), 95 % interval"
        f" {_percent(report.low)} to {_percent(report.high)}; seed {seed}"
    )
    for name, count in report.failures.items():
        console.print(f"  {spaced(name)}: {count} samples do not pass")
    if report.without_verdict:
        console.print(f"  {report.without_verdict} samples without verdict count as failed")
    for reason, count in list(report.reasons.items())[:REASONS]:
        console.print(f"    {count}: {reason}", markup=False)
    console.print(_spreads(report.quantities))
    if report.sensitivities:
        console.print(_sensitivities(report))
    if report.remedy is not None:
        console.print(remedy_text(report.remedy), markup=False, soft_wrap=True)


def remedy_text(remedy: Remedy) -> str:
    """Return what to buy better, and the yield with it."""
    wanted = _percent(remedy.target)
    if not remedy.what:
        return (
            f"no resistor or capacitor that is sold better brings the yield closer to {wanted}: the"
            " failures have other causes"
        )
    text = f"{remedy.what}: yield {_percent(remedy.fraction)}"
    if remedy.predicted < remedy.target:
        text = f"nothing that is sold better gives {wanted}; best: {text}"
    if not remedy.samples:
        return f"{text}, predicted from the samples"
    return (
        f"{text}, predicted {_percent(remedy.predicted)}; {remedy.passed} of the first"
        f" {remedy.samples} samples pass with these parts, 95 % interval {_percent(remedy.low)} to"
        f" {_percent(remedy.high)}"
    )


def print_corners(
    corners: tuple[Corner, ...], quantities: tuple[Quantity, ...], console: Console
) -> None:
    """Print every corner with its outcome, its failed checks and the components behind them."""
    rows = [
        (
            _name(corner),
            corner.result.outcome,
            *(_figure(corner.result.value(q.name), q.unit) for q in quantities),
        )
        for corner in corners
    ]
    titles = ("corner", "outcome", *(spaced(quantity.name) for quantity in quantities))
    console.print(make_table(titles, rows, padding=(0, 1, 0, 0)))
    for corner in corners:
        failed, largest = corner.result.failed, " ".join(corner.largest)
        remarks = (
            corner.result.lost,
            f"fails {', '.join(failed)}" if failed else "",
            f"most moved by {largest}" if largest else "",
        )
        if any(remarks):
            console.print(f"{_name(corner)}: {'; '.join(filter(None, remarks))}", markup=False)


def print_directions(directions: tuple[Direction, ...], console: Console) -> None:
    """Print the largest worst-case errors at rest, to first order and solved."""
    rows = [
        (
            str(each.channel),
            _figure(each.predicted, "step"),
            _figure(each.solved, "step"),
            " ".join(each.largest),
        )
        for each in directions[:SHOWN]
    ]
    titles = ("channel", "first order", "solved", "most moved by")
    caption = "worst-case errors at rest, from the signs of the sensitivities"
    if len(directions) > SHOWN:
        caption += f"; and {len(directions) - SHOWN} smaller ones"
    console.print(make_table(titles, rows, caption=caption))


def _name(corner: Corner) -> str:
    """Return the name of a corner in words, and a user's own name unchanged."""
    return spaced(corner.name) if corner.quantity else corner.name


def _spreads(spreads: tuple[Spread, ...]) -> FittedTable:
    rows = []
    for spread in spreads:
        limits = [
            f"{sign} {_figure(limit, spread.unit)}"
            for sign, limit in (("≥", spread.at_least), ("≤", spread.at_most))
            if limit is not None
        ]
        quantiles = [_figure(v, spread.unit) for v in (spread.low, spread.median, spread.high)]
        missing = str(spread.missing or "")
        rows.append((spaced(spread.name), ", ".join(limits), *quantiles, missing))
    return make_table(("quantity", "limit", "5 %", "median", "95 %", "missing"), rows)


def _sensitivities(report: YieldReport) -> FittedTable:
    rows = [
        (
            spaced(item.quantity) + ("" if item.channel is None else f", channel {item.channel}"),
            f"{item.parameter} ({item.kind})",
            f"{item.correlation:+.2f} ± {item.standard_error:.2f}",
            f"{100 * item.correlation**2:.0f} %",
        )
        for item in report.sensitivities[:TOP]
    ]
    return make_table(("quantity", "component", "correlation", "of the variance"), rows)


def _percent(value: float) -> str:
    return f"{100 * value:.4g} %"


def _figure(value: float | None, unit: str) -> str:
    if value is not None and math.isinf(value):
        return "never"
    return value_text(value, unit, 3 if unit in UNITS else 4)
