"""Yields and corners as tables for people."""

from __future__ import annotations

import math

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from netlist_gen.quantities import show
from verification.studies.tolerance.corners import Corner
from verification.studies.tolerance.varied_board import Quantity
from verification.studies.tolerance.yield_report import Spread, YieldReport

TOP = 10  # sensitivities that are shown; JSON has them all
REASONS = 3


def print_yield(found: YieldReport, seed: int) -> None:
    """Print the yield with its interval, what failed and by how much, and what matters."""
    console = Console(highlight=False)
    if not found.samples:
        console.print("no sample: no yield")
        return
    console.print(
        f"yield {_percent(found.fraction)} ({found.passed} of {found.samples}), 95 % interval"
        f" {_percent(found.low)} to {_percent(found.high)}; seed {seed}"
    )
    for name, count in found.failures.items():
        console.print(f"  {name.replace('_', ' ')}: {count} samples do not pass")
    if found.without_verdict:
        console.print(f"  {found.without_verdict} samples without verdict count as not passed")
    for reason, count in list(found.reasons.items())[:REASONS]:
        console.print(f"    {count}: {reason}", markup=False)
    console.print(_spreads(found.quantities))
    if found.sensitivities:
        console.print(_sensitivities(found))


def print_corners(found: tuple[Corner, ...], told: tuple[Quantity, ...]) -> None:
    """Print every corner with its outcome and what decides it."""
    names = [quantity.name.replace("_", " ") for quantity in told]
    table = Table(
        "corner", "outcome", *names, box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)
    )
    console = Console(highlight=False)
    for corner in found:
        result = corner.result
        figures = [_figure(getattr(result, q.name), q.unit) for q in told]
        table.add_row(_name(corner), result.outcome, *figures)
    console.print(table)
    for corner in found:
        words = [corner.result.reason, f"fails {', '.join(corner.result.failed)}"]
        said = "; ".join(words[: 1 + bool(corner.result.failed)]).strip("; ")
        decided = f" most moved by {' '.join(corner.largest)}" if corner.largest else ""
        if said or decided:
            console.print(
                f"{_name(corner)}: {said}{';' if said and decided else ''}{decided}", markup=False
            )


def _name(corner: Corner) -> str:
    """Return the name as people read it; a user's own words stay as they are."""
    return corner.name.replace("_", " ") if corner.quantity else corner.name


def _spreads(spreads: tuple[Spread, ...]) -> Table:
    table = Table("quantity", "wanted", "5 %", "median", "95 %", "none", box=SIMPLE_HEAD)
    for spread in spreads:
        wanted = [
            f"{sign} {_figure(limit, spread.unit)}"
            for sign, limit in (("≥", spread.at_least), ("≤", spread.at_most))
            if limit is not None
        ]
        quantiles = [_figure(v, spread.unit) for v in (spread.low, spread.median, spread.high)]
        missing = str(spread.missing or "")
        table.add_row(spread.name.replace("_", " "), ", ".join(wanted), *quantiles, missing)
    return table


def _sensitivities(found: YieldReport) -> Table:
    table = Table("quantity", "component", "correlation", "of the variance", box=SIMPLE_HEAD)
    for item in found.sensitivities[:TOP]:
        where = "" if item.channel is None else f", channel {item.channel}"
        table.add_row(
            item.quantity.replace("_", " ") + where,
            f"{item.parameter} ({item.kind})",
            f"{item.correlation:+.2f} ± {item.standard_error:.2f}",
            f"{100 * item.correlation**2:.0f} %",
        )
    return table


def _percent(value: float) -> str:
    return f"{100 * value:.4g} %"


def _figure(value: float | None, unit: str) -> str:
    if value is None or math.isnan(value):
        return "-"
    if math.isinf(value):
        return "never"
    if unit == "step":
        return f"{100 * value:.3g} %"
    if unit == "ratio":
        return f"{value:.4g}"
    return f"{value:.4g} /s" if unit == "1/s" else show(value, unit, 3)
