"""A regression run as text: the rows that all its reports share, the table, the JSON document."""

from __future__ import annotations

from typing import Any

from taction.system.documents import plain
from taction.verification.report.verdict.json_document import check_record
from taction.verification.studies.regression.run import RegressionReport, SceneResult


def regression_document(report: RegressionReport) -> dict[str, Any]:
    """Return a run as plain data in SI base units; `off` is infinite for values of other kinds."""
    return {
        "exit_status": report.exit_status,
        "folder": report.folder,
        "baseline": report.baseline,
        "revision": report.revision,
        "updated": report.updated,
        "interrupted": report.interrupted,
        "counts": report.count(),
        "scenes": [_record(result) for result in report.results],
    }


def _record(result: SceneResult) -> dict[str, Any]:
    then, now = result.baseline, result.entry
    return {
        "file": result.file,
        "status": result.status.value,
        "outcome": now.record.outcome if now else None,
        "reason": result.reason,
        "notes": list(result.notes),
        "simulator": now.solved_by if now else None,
        "baseline": then
        and {
            "outcome": then.record.outcome,
            "revision": then.revision,
            "taction": then.taction,
            "simulator": then.solved_by,
            "fingerprint": then.fingerprint,
        },
        "worst": result.worst if result.differences else None,
        "checks": [check_record(check) for check in result.checks],
        "differences": [plain(each) for each in result.differences],
        "seconds": result.seconds,
    }
