"""Stability crossings as JSON and as a table."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.markup import escape

from taction.netlist_gen.scene.keys import own_value
from taction.system.quantities import show
from taction.verification.report.fitted_table import FittedTable
from taction.verification.report.tables import make_table
from taction.verification.stability.edges import Edge
from taction.verification.studies.onset.onset import CheckedEdge, Onset
from taction.verification.studies.onset.transient_trial import Side

CONFIRMED = {True: "[green]yes[/green]", False: "[red]no[/red]", None: "[yellow]undecided[/yellow]"}


def onset_document(onset: Onset) -> dict[str, Any]:
    """Return `onset` as plain data, SI base units."""
    samples = onset.scan.samples
    return {
        "scene": onset.scene.name,
        "file": str(onset.scene.file),
        "over": onset.axis.key.path,
        "unit": onset.axis.key.unit,
        "own_value": own_value(onset.scene, onset.axis.key),
        "scanned": {
            "from": samples[0].value,
            "to": samples[-1].value,
            "points": len(samples),
            "scale": "logarithmic" if onset.scan.logarithmic else "linear",
            "default": onset.axis.default,
        },
        "complete": onset.scan.complete,
        "crossings": [_finding(each, onset.scan.complete) for each in onset.findings],
        "unstable_counts": [asdict(count) for count in onset.counts],
        "stable_ranges": [list(pair) for pair in onset.scan.stable_ranges],
        "unresolved": [list(pair) for pair in onset.scan.unresolved],
        "failures": [{"value": s.value, "reason": s.failure} for s in samples if s.failure],
    }


def _finding(finding: CheckedEdge, complete: bool) -> dict[str, Any]:
    crossing, trial = finding.crossing, finding.confirmation
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


def direction(crossing: Edge) -> str:
    """Return the side of the crossing on which the mode grows."""
    return "unstable above" if crossing.unstable_above else "unstable below"


def print_onset(onset: Onset, console: Console) -> None:
    """Print the scanned range, the crossings, and the stable ranges."""
    samples, unit, name = onset.scan.samples, onset.axis.key.unit, onset.axis.name
    low, high = show(samples[0].value, unit), show(samples[-1].value, unit)
    range_ = f"{name} from {low} to {high}" + (" (default range)" if onset.axis.default else "")
    console.print(
        f"[bold]{escape(onset.scene.name)}[/bold]: {range_}, poles at {len(samples)} values"
    )
    if failed := [sample for sample in samples if sample.failure]:
        console.print(
            f"[yellow]no poles at {len(failed)} of them[/yellow], the first at"
            f" {show(failed[0].value, unit)}: {escape(failed[0].failure)}"
        )
    console.print(_table(onset) if onset.findings else "no crossing")
    for each in onset.findings:
        if each.confirmation.reason:
            where = show(each.crossing.value, unit, 7)
            console.print(f"{where}: {escape(each.confirmation.reason)}")
    if not onset.scan.complete:
        console.print(
            "large board: only the rightmost poles were computed, so the list has no modes that"
            " begin or cease to grow while other modes grow"
        )
    console.print(_counts(onset))
    console.print(f"stable: {_ranges(onset.scan.stable_ranges, unit) or 'nowhere in this range'}")
    if unresolved := _ranges(onset.scan.unresolved, unit):
        console.print(f"not resolved, a pole is on the axis to within rounding: {unresolved}")


def _ranges(ranges: tuple[tuple[float, float], ...], unit: str) -> str:
    return ", ".join(f"{show(low, unit)} to {show(high, unit)}" for low, high in ranges)


def _counts(onset: Onset) -> str:
    """Say whether the winding numbers between the crossings agree with the poles."""
    unit = onset.axis.key.unit
    wrong = [c for c in onset.counts if c.winding is not None and c.winding != c.poles]
    if wrong:
        parts = (f"{c.winding} not {c.poles} at {show(c.value, unit)}" for c in wrong)
        return "[red]winding numbers contradict the poles[/red]: " + ", ".join(parts)
    counted = sum(c.winding is not None for c in onset.counts)
    return f"winding numbers agree with the poles in {counted} of {len(onset.counts)} ranges"


def _table(onset: Onset) -> FittedTable:
    titles = ("crossing", "frequency", "unstable", "confirmed", "rate below", "rate above")
    complete = onset.scan.complete
    rows = [
        (
            show(crossing.value, onset.axis.key.unit, 7),
            show(crossing.frequency, "Hz", 5) if crossing.frequency else "real pole",
            f"{_count(crossing.below, complete)} → {_count(crossing.above, complete)}",
            CONFIRMED[trial.confirmed],
            _rates(trial.below),
            _rates(trial.above),
        )
        for crossing, trial in ((each.crossing, each.confirmation) for each in onset.findings)
    ]
    caption = (
        "unstable: poles right of the axis below and above the crossing;\n"
        "rate: 1/s, fitted to a transient (and real part of the pole)"
    )
    return make_table(titles, rows, caption=caption, collapse_padding=True)


def _count(unstable: int, complete: bool) -> str:
    return str(unstable) if complete or not unstable else "some"


def _rates(side: Side | None) -> str:
    if side is None:
        return "-"
    measured = "-" if side.growth_rate is None else f"{side.growth_rate:+.4g}"
    return f"{measured} ({side.predicted.real:+.4g})"
