"""A sweep as a JSON document and as a table."""

from __future__ import annotations

import json
from collections.abc import Iterator

from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import plain
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.report.documents.catalogue import document_head
from taction.verification.report.documents.studies import AgreementPart, AxisPart, SweepDocument
from taction.verification.report.sweep.agreement import summarise
from taction.verification.report.sweep.records import records
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.run import SweepCounts

COLUMNS = ("settling_time", *EXCURSIONS, "growth_rate", "frequency")


def columns_of(scene: Scene) -> tuple[str, ...]:
    """Return the figures in the table of a sweep: `COLUMNS`, and the noise if it has a limit."""
    return COLUMNS if scene.checks.noise is None else (*COLUMNS, "noise")


def document_parts(plan: Plan, store: Store, count: SweepCounts, seconds: float) -> Iterator[str]:
    """Yield the JSON document in pieces, since it may be larger than the memory."""
    made = SweepDocument(
        scene=plan.scene.name,
        file=str(plan.scene.file),
        database=store.path,
        axes=tuple(AxisPart.of(a, k) for k, group in enumerate(plan.groups) for a in group),
        engines=plan.engines,
        total=count.total,
        done=count.done,
        ran=count.ran,
        outcomes=dict(count.outcomes),
        agreement=AgreementPart.of(summarise(plan, store)) if len(plan.engines) > 1 else None,
        seconds=seconds,
        estimated_seconds=count.estimate,
    )
    head = document_head("sweep") | plain(made)
    del head["points"]
    yield json.dumps(head, indent=2, ensure_ascii=False, allow_nan=False)[:-2]
    yield ',\n  "points": ['
    between = "\n    "
    for record in records(plan, store):
        yield between + json.dumps(record, ensure_ascii=False, allow_nan=False)
        between = ",\n    "
    yield "\n  ]\n}\n"
