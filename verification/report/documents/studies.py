"""The documents of studies, in SI base units: results with what a reader needs beside them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated

from taction.netlist_gen.scene.axes import Axis
from taction.netlist_gen.scene.keys import Value
from taction.system.documents import (
    INLINE,
    Note,
    Number,
    Seconds,
    plain,
    taken,
)
from taction.verification.studies.sweep.result import SweepResult
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import Record

Pair = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class AxisPart:
    """An axis of a grid; axes of one `group` change together."""

    name: str
    key: str
    unit: str
    scale: str
    group: int
    values: tuple[Value, ...]

    @classmethod
    def of(cls, axis: Axis, group: int) -> AxisPart:
        """Return an axis."""
        known = axis.key.path, axis.key.unit, axis.scale
        return cls(axis.name, *known, group, tuple(axis.values))


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """A point of a sweep on one engine; `values` by the names of the axes."""

    values: dict[str, Value]
    record: Annotated[Record, INLINE]
    rightmost_pole: Annotated[Pair | None, "1/s"]
    chosen: Annotated[str | None, Note("why a hybrid sweep confirms the point by ngspice")]
    agreement: Annotated[Outcome | None, Note("of both engines")]
    difference: Number
    disagreement: str | None


@dataclass(frozen=True, slots=True)
class AgreementPart:
    """How far two engines agree."""

    points: int
    agree: int
    disagree: int
    undecided: int
    chosen: Mapping[str, int]
    largest_difference: Number
    at: dict[str, Value] | None
    listed: tuple[SweepPoint, ...]


@dataclass(frozen=True, slots=True)
class SweepDocument:
    """``taction sweep``; the points follow one by one, since they may be many."""

    scene: str
    file: str
    database: str
    axes: tuple[AxisPart, ...]
    engines: tuple[str, ...]
    total: int
    done: int
    ran: int
    outcomes: dict[str, int]
    agreement: AgreementPart | None
    seconds: Seconds
    estimated_seconds: Seconds
    points: tuple[SweepPoint, ...] = ()

    @classmethod
    def pieces(cls, found: SweepResult) -> Iterator[str]:
        """Yield the JSON document in pieces, since it may be larger than the memory."""
        from taction.verification.report.documents.catalogue import document_head

        plan, count = found.plan, found.count
        made = cls(
            scene=plan.scene.name,
            file=str(plan.scene.file),
            database=found.store.path,
            axes=tuple(AxisPart.of(a, k) for k, group in enumerate(plan.groups) for a in group),
            engines=plan.engines,
            total=count.total,
            done=count.done,
            ran=count.ran,
            outcomes=dict(count.outcomes),
            agreement=None if found.agreement is None else taken(AgreementPart, found.agreement),
            seconds=found.seconds,
            estimated_seconds=count.estimate,
        )
        head = document_head("sweep") | plain(made)
        del head["points"]
        yield json.dumps(head, indent=2, ensure_ascii=False, allow_nan=False)[:-2]
        yield ',\n  "points": ['
        between = "\n    "
        for record in found.records():
            yield between + json.dumps(record, ensure_ascii=False, allow_nan=False)
            between = ",\n    "
        yield "\n  ]\n}\n"
