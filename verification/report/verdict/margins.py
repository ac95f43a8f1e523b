"""A verdict's document with the stability margins, which cost a search of their own."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from taction.verification.design.stable_ranges import stable_ranges
from taction.verification.design.trials import Trials
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.report.verdict.json_document import verdict_document
from taction.verification.report.verdict.remedies import range_record
from taction.verification.stability.margin import margins as knob_margins
from taction.verification.verdict.verify import Verdict


def verdict_document_with_margins(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict_document` with the stability margins in C and in the gain.

    An unstable board has the nearest stable range of each key, too.
    """
    document = verdict_document(verdict)
    margins = knob_margins(LinearBoard(verdict.circuit), verdict.poles)
    records: dict[str, Any] = {name: asdict(margin) for name, margin in margins.items()}
    if verdict.poles.known_unstable:
        records |= {each.path: range_record(each) for each in stable_ranges(Trials(verdict.scene))}
    document["stability"]["margins"] = records
    return document
