"""An onset as JSON and as a table."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from netlist_gen.overrides.keys import own_value
from netlist_gen.quantities import show
from verification.studies.onset.onset import Finding, Onset
from verification.studies.onset.scan_result import AxisCrossing
from verification.studies.onset.transient_trial import Side

SAYS = {True: "[green]yes[/green]", False: "[red]no[/red]", None: "[yellow]undecided[/yellow]"}


def onset_document(found: Onset) -> dict[str, Any]:
    """Return `found` as plain data, SI base units."""
    samples = found.scan.samples
    own = own_value(found.scene, found.axis.key)
    return {
        "scene": found.scene.name,
        "file": str(found.scene.file),
        "over": found.axis.key.path,
        "unit": found.axis.key.unit,
        "own_value": own,
        "scanned": {
            "from": samples[0].value,
            "to": samples[-1].value,
            "points": len(samples),
            "scale": "logarithmic" if found.scan.logarithmic else "linear",
            "default": found.axis.default,
        },
        "complete": found.scan.complete,
        "crossings": [_finding(each, found.scan.complete) for each in found.findings],
        "unstable_counts": [asdict(count) for count in found.counts],
        "stable_ranges": [list(pair) for pair in found.scan.stable_ranges],
        "failures": [{"value": s.value, "reason": s.failure} for s in samples if s.failure],
    }


def _finding(found: Finding, complete: bool) -> dict[str, Any]:
    crossing, trial = found.crossing, found.confirmation
    return {
        "value": crossing.value,
        "frequency": crossing.frequency,
        "direction": direction(crossing),
        "changes_stability": crossing.changes_stability,
        "unstable_poles": (
            {"below": crossing.below, "above": crossing.above} if complete else None
        ),
        "confirmed": trial.confirmed,
        "reason": trial.reason,
        "below": _side(trial.below),
        "above": _side(trial.above),
    }


def _side(side: Side | None) -> dict[str, Any] | None:
    if side is None:
        return None
    return {
        "value": side.value,
        "predicted": {
            "growth_rate": side.predicted.real,
            "frequency": abs(side.predicted.imag) / (2.0 * math.pi),
        },
        "measured": {
            "growth_rate": side.growth_rate,
            "growth_rate_uncertainty": side.growth_sigma,
            "frequency": side.frequency,
        },
        "agrees": side.agrees,
        "reason": side.reason,
    }


def direction(crossing: AxisCrossing) -> str:
    """Return on which side of the crossing its mode grows."""
    return "unstable above" if crossing.unstable_above else "unstable below"


def print_onset(found: Onset, console: Console) -> None:
    """Print what was scanned, the crossings, and where the board is stable."""
    samples, unit, name = found.scan.samples, found.axis.key.unit, found.axis.name
    low, high = show(samples[0].value, unit), show(samples[-1].value, unit)
    range_ = f"{name} from {low} to {high}" + (" (default range)" if found.axis.default else "")
    console.print(
        f"[bold]{escape(found.scene.name)}[/bold]: {range_}, poles at {len(samples)} values"
    )
    failed = sum(bool(sample.failure) for sample in samples)
    if failed:
        first = next(sample for sample in samples if sample.failure)
        console.print(
            f"[yellow]no poles at {failed} of them[/yellow], the first at"
            f" {show(first.value, unit)}: {escape(first.failure)}"
        )
    if found.findings:
        console.print(_table(found))
    else:
        console.print("no crossing")
    for each in found.findings:
        if each.confirmation.reason:
            where = show(each.crossing.value, unit, 7)
            console.print(f"{where}: {escape(each.confirmation.reason)}")
    if not found.scan.complete:
        console.print(
            "large board: only its rightmost poles were looked for, so modes that begin or cease to"
            " grow while others do are not listed"
        )
    console.print(_counts(found))
    ranges = ", ".join(f"{show(a, unit)} to {show(b, unit)}" for a, b in found.scan.stable_ranges)
    console.print(f"stable: {ranges or 'nowhere in this range'}")


def _counts(found: Onset) -> str:
    """Say whether the winding numbers between the crossings agree with the poles."""
    unit = found.axis.key.unit
    wrong = [c for c in found.counts if c.winding is not None and c.winding != c.poles]
    if wrong:
        parts = (f"{c.winding} not {c.poles} at {show(c.value, unit)}" for c in wrong)
        return "[red]winding numbers contradict the poles[/red]: " + ", ".join(parts)
    counted = sum(c.winding is not None for c in found.counts)
    return f"winding numbers agree with the poles in {counted} of {len(found.counts)} ranges"


def _table(found: Onset) -> Table:
    titles = ("crossing", "frequency", "unstable", "confirmed", "rate below", "rate above")
    table = Table(*titles, box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    complete = found.scan.complete
    for each in found.findings:
        crossing, trial = each.crossing, each.confirmation
        table.add_row(
            show(crossing.value, found.axis.key.unit, 7),
            show(crossing.frequency, "Hz", 5) if crossing.frequency else "real pole",
            f"{_count(crossing.below, complete)} → {_count(crossing.above, complete)}",
            SAYS[trial.confirmed],
            _rates(trial.below),
            _rates(trial.above),
        )
    table.caption = (
        "unstable: poles right of the axis below and above the crossing;\n"
        "rate: 1/s, fitted to a transient beside it (and of the pole)"
    )
    table.caption_justify = "left"
    return table


def _count(unstable: int, complete: bool) -> str:
    return str(unstable) if complete or not unstable else "some"


def _rates(side: Side | None) -> str:
    if side is None:
        return "-"
    measured = "-" if side.growth_rate is None else f"{side.growth_rate:+.4g}"
    return f"{measured} ({side.predicted.real:+.4g})"
