"""Stability crossings as JSON and as a table."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from taction.netlist_gen.scene.keys import own_value
from taction.verification.report.views.onset import direction
from taction.verification.studies.onset.onset import CheckedEdge, Onset
from taction.verification.studies.onset.transient_trial import Side


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
