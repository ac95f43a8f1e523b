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
from taction.verification.evidence.paper.reproduce import Judged, Reproduction
from taction.verification.evidence.stress.compare import Comparison
from taction.verification.evidence.stress.run import CaseRun, StressReport
from taction.verification.studies.running.versions import describe_machine
from taction.verification.studies.sweep.result import SweepResult
from taction.verification.studies.work_precision.errors import NORMS, ProblemErrors
from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.study import (
    ERRORS,
    SettingResult,
    WorkPrecisionStudy,
)
from taction.verification.verdict.checks import Check, Outcome
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


@dataclass(frozen=True, slots=True)
class StressNumber:
    """A stated number beside its true value, in `unit`."""

    name: str
    value: Number
    uncertainty: Number
    truth: Number
    error: Number
    unit: str
    outside: bool
    wrong: bool

    @classmethod
    def of(cls, found: Comparison) -> StressNumber:
        """Return a number."""
        return taken(cls, found)


@dataclass(frozen=True, slots=True)
class StressRun:
    """A case on one engine."""

    case: str
    family: str
    engine: str
    why: Annotated[str, Note("what makes the case hard")]
    known: Annotated[str, Note("how the true values are known")]
    judgement: str
    outcome: str
    right_outcomes: tuple[str, ...]
    reason: str
    seconds: Seconds
    checks: tuple[Check, ...]
    numbers: tuple[StressNumber, ...]

    @classmethod
    def of(cls, run: CaseRun) -> StressRun:
        """Return a run."""
        case = run.case
        return taken(
            cls,
            run,
            case=case.name,
            family=case.family,
            why=case.why,
            known=case.known,
            judgement=run.judgement.value,
            right_outcomes=tuple(case.outcome[run.engine]),
            numbers=tuple(map(StressNumber.of, run.comparisons)),
        )


@dataclass(frozen=True, slots=True)
class StressDocument:
    """``taction self stress``."""

    runs: tuple[StressRun, ...]
    count: dict[str, int]
    numbers: int
    outside: int
    versions: dict[str, str | None]

    @classmethod
    def of(cls, report: StressReport) -> StressDocument:
        """Return a run of the catalogue."""
        runs, versions = tuple(map(StressRun.of, report.runs)), dict[str, str | None]()
        versions.update(report.versions)
        return taken(cls, report, runs=runs, count=report.count(), versions=versions)


@dataclass(frozen=True, slots=True)
class MethodPart:
    """A method with its settings and its order of convergence."""

    name: str
    engine: str
    problem: str
    setting: str
    order: Number
    order_uncertainty: Number
    order_theory: Number
    order_theory_says: str
    order_points: Annotated[tuple[float, ...], Note("settings that the fit used")]
    order_reason: str
    points: tuple[SettingResult, ...]

    @classmethod
    def of(cls, study: WorkPrecisionStudy, method: Method) -> MethodPart:
        """Return a method."""
        order, points = study.orders[method.name], study.of(method)
        return taken(
            cls,
            method,
            order=order.value,
            order_uncertainty=order.sigma,
            order_theory=method.order,
            order_theory_says=method.theory,
            order_points=tuple(points[place].setting for place in order.points),
            order_reason=order.reason,
            points=points,
        )


@dataclass(frozen=True, slots=True)
class CheapestSetting:
    """The setting with the least run time below an error."""

    method: str
    setting: Number
    seconds: Seconds
    achieved: Number


@dataclass(frozen=True, slots=True)
class Cheapest:
    """The cheapest setting below an error: of any engine, and of ngspice."""

    error: Number
    any: CheapestSetting | None
    ngspice: CheapestSetting | None

    @classmethod
    def of(cls, study: WorkPrecisionStudy, error: float) -> Cheapest:
        """Return the cheapest settings."""
        points = study.cheapest(error, engines=None), study.cheapest(error, engines=["ngspice"])
        return cls(error, *map(_cheapest, points))


def _cheapest(point: SettingResult | None) -> CheapestSetting | None:
    if point is None:
        return None
    known = point.known_setting, point.seconds, point.errors["maximum"]
    return CheapestSetting(point.method.name, *known)


@dataclass(frozen=True, slots=True)
class AccuracyDocument:
    """``taction self accuracy``; errors are fractions by norm, null where unknown."""

    scene: str
    file: str
    stop: Seconds
    whole_stop: Seconds
    stretch: str
    period: Seconds
    pole: Annotated[complex | None, "1/s"]
    norms: tuple[str, ...]
    problems: dict[str, ProblemErrors]
    methods: tuple[MethodPart, ...]
    cheapest: tuple[Cheapest, ...]
    omissions: tuple[str, ...]
    machine: dict[str, str | int | float | None]
    seconds: Seconds

    @classmethod
    def of(cls, study: WorkPrecisionStudy) -> AccuracyDocument:
        """Return a study."""
        extent = study.extent
        methods = dict.fromkeys(point.method for point in study.points)
        return taken(
            cls,
            study,
            scene=study.scene.name,
            file=str(study.scene.file),
            stop=extent.transient.stop,
            whole_stop=extent.whole,
            stretch=extent.text,
            period=extent.period,
            pole=extent.pole,
            norms=tuple(NORMS),
            methods=tuple(MethodPart.of(study, method) for method in methods),
            cheapest=tuple(Cheapest.of(study, error) for error in ERRORS),
        )


@dataclass(frozen=True, slots=True)
class ClaimPart:
    """A claim of the paper; `values` holds the numbers behind `ours`, in SI base units."""

    id: str
    claim: str
    place: str
    run: str
    printed: str
    ours: str
    verdict: str
    expected: str
    as_expected: bool
    values: dict[str, float]

    @classmethod
    def of(cls, each: Judged) -> ClaimPart:
        """Return a claim with what was found."""
        claim, found = each.claim, each.finding
        return taken(
            cls,
            claim,
            run=found.run,
            ours=found.ours,
            verdict=found.outcome.value,
            expected=claim.expected.value,
            as_expected=each.as_expected,
            values=found.values,
        )


@dataclass(frozen=True, slots=True)
class ChapterPart:
    """A part of the run."""

    title: str
    seconds: Seconds


@dataclass(frozen=True, slots=True)
class ReproduceDocument:
    """``taction reproduce``."""

    outcome: str
    quick: bool
    seconds: Seconds
    machine: dict[str, str | int | float | None]
    claims: tuple[ClaimPart, ...]
    left_out: tuple[str, ...]
    chapters: tuple[ChapterPart, ...]

    @classmethod
    def of(cls, result: Reproduction) -> ReproduceDocument:
        """Return a run."""
        return taken(
            cls,
            result,
            machine=describe_machine(),
            claims=tuple(map(ClaimPart.of, result.judged)),
            left_out=tuple(claim.id for claim in result.left_out),
            chapters=tuple(taken(ChapterPart, section) for section in result.sections),
        )
