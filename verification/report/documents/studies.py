"""The documents of studies, in SI base units: results with what a reader needs beside them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from taction.netlist_gen.scene.axes import Axis
from taction.netlist_gen.scene.keys import Value, own_value
from taction.system.documents import (
    INLINE,
    OPTIONAL,
    Hertz,
    Key,
    Note,
    Number,
    Rate,
    Seconds,
    Steps,
    Volts,
    plain,
    taken,
)
from taction.verification.design.choose import Confirmation, Design
from taction.verification.evidence.paper.reproduce import Judged, Reproduction
from taction.verification.evidence.stress.compare import Comparison
from taction.verification.evidence.stress.run import CaseRun, StressReport
from taction.verification.stability.edges import Edge
from taction.verification.studies.onset.onset import CheckedEdge, Count, Onset
from taction.verification.studies.onset.transient_trial import Side
from taction.verification.studies.regression.run import RegressionReport, SceneResult
from taction.verification.studies.running.versions import describe_machine
from taction.verification.studies.sweep.result import SweepResult
from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.norms import NORMS
from taction.verification.studies.work_precision.run_errors import ProblemErrors
from taction.verification.studies.work_precision.study import (
    ERRORS,
    SettingResult,
    WorkPrecisionStudy,
)
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.compare import Difference
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
class Scanned:
    """The values whose poles were computed."""

    low: Annotated[Number, Key("from")]
    high: Annotated[Number, Key("to")]
    points: int
    scale: str
    default: bool


@dataclass(frozen=True, slots=True)
class CrossingMode:
    """The crossing mode: from the poles, or fitted to the transient with an uncertainty."""

    growth_rate: Rate
    frequency: Hertz
    growth_rate_uncertainty: Annotated[float | None, "1/s", OPTIONAL] = None


@dataclass(frozen=True, slots=True)
class SidePart:
    """A transient beside a crossing."""

    value: Number
    predicted: CrossingMode
    measured: CrossingMode
    agrees: bool | None
    reason: str

    @classmethod
    def of(cls, side: Side) -> SidePart:
        """Return one side."""
        pole = side.predicted
        predicted = CrossingMode(pole.real, abs(pole.imag) / (2.0 * math.pi))
        measured = CrossingMode(side.growth_rate, side.frequency, side.growth_sigma)
        return cls(side.value, predicted, measured, side.agrees, side.reason)


@dataclass(frozen=True, slots=True)
class UnstablePoles:
    """Poles right of the imaginary axis on both sides of a crossing."""

    below: int
    above: int


@dataclass(frozen=True, slots=True)
class CrossingPart:
    """A value at which a pole is on the imaginary axis."""

    value: Number
    frequency: Hertz
    direction: str
    changes_stability: bool
    unstable_poles: UnstablePoles | None
    confirmed: bool | None
    reason: str
    below: SidePart | None
    above: SidePart | None

    @classmethod
    def of(cls, found: CheckedEdge, complete: bool) -> CrossingPart:
        """Return a crossing; the numbers of poles are known of a `complete` scan."""
        edge, trial = found.crossing, found.confirmation
        return cls(
            value=edge.value,
            frequency=edge.frequency,
            direction=direction(edge),
            changes_stability=edge.changes_stability,
            unstable_poles=UnstablePoles(edge.below, edge.above) if complete else None,
            confirmed=trial.confirmed,
            reason=trial.reason,
            below=None if trial.below is None else SidePart.of(trial.below),
            above=None if trial.above is None else SidePart.of(trial.above),
        )


def direction(crossing: Edge) -> str:
    """Return the side of the crossing on which the mode grows."""
    return "unstable above" if crossing.unstable_above else "unstable below"


@dataclass(frozen=True, slots=True)
class WithoutPoles:
    """A value whose poles could not be computed."""

    value: Number
    reason: str


@dataclass(frozen=True, slots=True)
class OnsetDocument:
    """``taction onset``."""

    scene: str
    file: str
    over: str
    unit: str
    own_value: Number
    scanned: Scanned
    complete: bool
    crossings: tuple[CrossingPart, ...]
    unstable_counts: tuple[Count, ...]
    stable_ranges: tuple[Pair, ...]
    unresolved: tuple[Pair, ...]
    failures: tuple[WithoutPoles, ...]

    @classmethod
    def of(cls, onset: Onset) -> OnsetDocument:
        """Return the crossings over an axis."""
        axis, scan = onset.axis, onset.scan
        ends = scan.samples[0].value, scan.samples[-1].value
        scale = "logarithmic" if scan.logarithmic else "linear"
        return cls(
            scene=onset.scene.name,
            file=str(onset.scene.file),
            over=axis.key.path,
            unit=axis.key.unit,
            own_value=own_value(onset.scene, axis.key),
            scanned=Scanned(*ends, len(scan.samples), scale, axis.default),
            complete=scan.complete,
            crossings=tuple(CrossingPart.of(each, scan.complete) for each in onset.findings),
            unstable_counts=onset.counts,
            stable_ranges=tuple(scan.stable_ranges),
            unresolved=tuple(scan.unresolved),
            failures=tuple(WithoutPoles(s.value, s.failure) for s in scan.samples if s.failure),
        )


@dataclass(frozen=True, slots=True)
class BaselineOrigin:
    """Where an entry of a baseline comes from."""

    outcome: str
    revision: str
    taction: str
    simulator: str
    fingerprint: str


@dataclass(frozen=True, slots=True)
class RegressionScene:
    """A scene beside its baseline."""

    file: str
    status: str
    outcome: str | None
    reason: str
    notes: tuple[str, ...]
    simulator: str | None
    baseline: BaselineOrigin | None
    worst: Annotated[Number, Note("of the differences, over what is allowed")]
    checks: tuple[Check, ...]
    differences: Annotated[tuple[Difference, ...], Note("the baseline is the first")]
    seconds: Seconds

    @classmethod
    def of(cls, result: SceneResult) -> RegressionScene:
        """Return a scene."""
        then, now = result.baseline, result.entry
        origin = then and taken(
            BaselineOrigin, then, outcome=then.record.outcome, simulator=then.solved_by
        )
        return taken(
            cls,
            result,
            status=result.status.value,
            outcome=now and now.record.outcome,
            simulator=now and now.solved_by,
            baseline=origin,
            worst=result.worst if result.differences else None,
        )


@dataclass(frozen=True, slots=True)
class RegressDocument:
    """``taction regress``."""

    exit_status: int
    folder: str
    baseline: str
    revision: str
    updated: bool
    interrupted: bool
    counts: dict[str, int]
    scenes: tuple[RegressionScene, ...]

    @classmethod
    def of(cls, report: RegressionReport) -> RegressDocument:
        """Return a run."""
        scenes = tuple(map(RegressionScene.of, report.results))
        return taken(cls, report, counts=report.count(), scenes=scenes)


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
    """``taction stress``."""

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
class MeasuredProblem:
    """A problem that methods solve, with its reference; `ringing` is the ringing pole."""

    references: tuple[str, ...]
    reference_error: Mapping[str, float | None]
    step_amplitude: Volts
    settling_band: Number
    settling_time: Seconds
    ringing: Annotated[complex | None, "1/s"]

    @classmethod
    def of(cls, errors: ProblemErrors) -> MeasuredProblem:
        """Return a problem."""
        names = ("amplitude", "band", "settling_time", "ringing")
        scale = [getattr(errors.scale, name, None) for name in names]
        return cls(errors.references, errors.floor, *scale)


@dataclass(frozen=True, slots=True)
class SettingPart:
    """A method with one setting."""

    setting: Number
    status: str
    seconds: Seconds
    seconds_fastest: Seconds
    seconds_slowest: Seconds
    repeats: int
    steps: int | None
    factorisations: int | None
    mean_step: Seconds
    errors: Mapping[str, float | None]
    reference: str
    note: str

    @classmethod
    def of(cls, point: SettingResult) -> SettingPart:
        """Return a setting; some methods have none."""
        return taken(
            cls,
            point,
            setting=point.setting if point.method.setting else None,
            seconds_fastest=point.fastest,
            seconds_slowest=point.slowest,
        )


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
    points: tuple[SettingPart, ...]

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
            points=tuple(map(SettingPart.of, points)),
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
    setting = point.setting if point.method.setting else None
    return CheapestSetting(point.method.name, setting, point.seconds, point.errors["maximum"])


@dataclass(frozen=True, slots=True)
class AccuracyDocument:
    """``taction accuracy``; errors are fractions by norm, null where unknown."""

    scene: str
    file: str
    stop: Seconds
    whole_stop: Seconds
    stretch: str
    period: Seconds
    pole: Annotated[complex | None, "1/s"]
    norms: tuple[str, ...]
    problems: dict[str, MeasuredProblem]
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
            problems={name: MeasuredProblem.of(each) for name, each in study.problems.items()},
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


@dataclass(frozen=True, slots=True)
class ChosenDesign:
    """One design of a choice; `values` by dotted paths, `shares` of the limits by check."""

    place: int
    values: dict[str, Value]
    outcome: str
    left: tuple[str, ...]
    shares: dict[str, float]
    settling_time: Seconds
    overshoot: Steps
    headroom: Number
    noise_rms: Volts
    reason: str
    refused: str
    worst_share: Number

    @classmethod
    def of(cls, design: Design) -> ChosenDesign:
        """Return a design."""
        share = design.worst if design.shares else None
        return taken(cls, design, noise_rms=design.noise, worst_share=share)


@dataclass(frozen=True, slots=True)
class BestDesign:
    """One of the best designs, with what ngspice says."""

    design: Annotated[ChosenDesign, INLINE]
    ngspice: Outcome | None
    ngspice_settling_time: Seconds
    ngspice_reason: str
    file: str | None


@dataclass(frozen=True, slots=True)
class ChooseDocument:
    """``taction choose``: all designs, the best first, and those that ngspice ran."""

    designs: tuple[ChosenDesign, ...]
    best: tuple[BestDesign, ...]

    @classmethod
    def of(
        cls,
        designs: Sequence[Design],
        best: Sequence[Design],
        confirmations: Sequence[Confirmation],
        files: Mapping[int, str],
    ) -> ChooseDocument:
        """Return a choice; `files` are the scene files of the best by their place of the grid."""
        chosen = tuple(
            BestDesign(
                ChosenDesign.of(design), said.outcome, said.settling_time, said.reason,
                files.get(design.place),
            )
            for design, said in zip(best, confirmations, strict=True)
        )  # fmt: skip
        return cls(tuple(map(ChosenDesign.of, designs)), chosen)
