"""A run of the stress cases for people and programs: one row per case and engine."""

from __future__ import annotations

from typing import Any

from taction.verification.evidence.stress.run import CaseRun, StressReport
from taction.verification.report.verdict.json_document import check_record


def stress_document(report: StressReport) -> dict[str, Any]:
    """Return a run as plain data: every case, every stated number and its true value."""
    return {
        "runs": [_record(run) for run in report.runs],
        "count": report.count(),
        "numbers": report.numbers,
        "outside": report.outside,
        "versions": dict(report.versions),
    }


def _record(run: CaseRun) -> dict[str, Any]:
    return {
        "case": run.case.name,
        "family": run.case.family,
        "engine": run.engine,
        "why": run.case.why,
        "known": run.case.known,
        "judgement": run.judgement.value,
        "outcome": run.outcome,
        "right_outcomes": list(run.case.outcome[run.engine]),
        "reason": run.reason,
        "seconds": run.seconds,
        "checks": [check_record(check) for check in run.checks],
        "numbers": [
            {
                "name": c.name,
                "value": c.value,
                "uncertainty": c.uncertainty,
                "truth": c.truth,
                "error": c.error,
                "unit": c.unit,
                "outside": c.outside,
                "wrong": c.wrong,
            }
            for c in run.comparisons
        ],
    }
