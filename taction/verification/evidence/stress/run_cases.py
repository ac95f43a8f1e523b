"""Run the catalogue of stress cases, and judge outcomes and numbers by the true ones."""

from __future__ import annotations

import enum
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import INTERRUPTED, Interrupted, SimulatorNotFound, SimulatorTooOld
from taction.system.progress import Notice, Progress
from taction.system.reading_definitions import READINGS
from taction.system.results import Result
from taction.verification.evidence.stress.catalogue import Case, TrueValues, load_catalogue, select
from taction.verification.studies.running.study import for_each
from taction.verification.studies.running.versions import describe_machine
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.transient_plan import SHARE
from taction.verification.verdict.verify import Verdict, verify

MARGIN = 1e-5  # of a margin: its stated error
LEAST_TOLERANCE = 1e-3  # of the step: a scene that asks for less allows it for its readings
LAST_LEVEL = 0.1  # of the step: distance of a rise time's last level from the target
NETWORK = ("steady_state", *READINGS)
PASSED = {True: Outcome.PASS, False: Outcome.FAIL}
RESTING = ("steady_state", "settling_time")  # also judged by where drawn boards rest


@dataclass(frozen=True, slots=True)
class TruthComparison:
    """One stated number with its true value."""

    DOCUMENT = ("name", "value", "uncertainty", "truth", "error", "unit", "outside", "wrong")

    name: str  # of the quantity, with its channel
    value: float  # as the verdict states it, in `unit`
    uncertainty: float
    truth: float  # NaN where there is none, although one is stated
    unit: str  # "s", "1/s", "step", "V" or "ratio"
    doubt: float  # error of `truth`
    accuracy: float  # the error that the scene allows, in `unit`

    @property
    def error(self) -> float:
        """The true error of the stated value."""
        return abs(self.value - self.truth)

    @property
    def ratio(self) -> float:
        """True error over stated error."""
        excess = self.error - self.doubt
        if excess <= 0.0:
            return min(self.error / self.uncertainty, 1.0) if self.uncertainty > 0.0 else 1.0
        return excess / self.uncertainty if self.uncertainty > 0.0 else math.inf

    @property
    def outside(self) -> bool:
        """Whether the true value is outside the stated uncertainty."""
        return not self.ratio <= 1.0

    @property
    def wrong(self) -> bool:
        """Whether the true value is outside by more than the scene allows, or does not exist."""
        return not self.error <= self.doubt + self.uncertainty + self.accuracy


def compare(verdict: Verdict, truth: TrueValues) -> tuple[TruthComparison, ...]:
    """Compare every number that a verdict states with its true value."""
    found = []
    for name, value, uncertainty, true, unit in _stated(verdict, truth):
        # Errors of times, poles and margins are relative, those of voltages are of the step.
        size = {"step": 1.0, "V": truth.amplitude}.get(unit, abs(true))
        errors = truth.error * size, _allowed(verdict.scene, name) * size
        found.append(TruthComparison(name, value, uncertainty, true, unit, *errors))
    return tuple(found)


def _stated(verdict: Verdict, truth: TrueValues) -> Iterator[tuple[Any, ...]]:
    """Yield name, value, stated error, true value and unit of every number of a verdict."""
    if truth.rightmost[0] < 0.0 and truth.arrives and truth.amplitude:
        steady = verdict.steady
        for n, (value, true) in enumerate(zip(steady.values, truth.channels, strict=True), 1):
            yield f"final value of u_{n}", float(value), steady.error, true["final"], "V"
        if truth.readable and verdict.outcome is not Outcome.INCONCLUSIVE:
            yield from _readings(verdict, truth)
    poles, margin = verdict.poles, verdict.margin
    yield "rightmost pole", poles.rightmost.real, poles.resolution, truth.rightmost[0], "1/s"
    if margin is not None and truth.margin is not None:
        yield "margin", margin.factor, MARGIN * margin.factor, truth.margin, "ratio"


def _readings(verdict: Verdict, truth: TrueValues) -> Iterator[tuple[Any, ...]]:
    """Yield the numbers of the decided checks of the network, and the readings of the channels."""
    for check in verdict.checks:
        value, uncertainty = check.value, check.uncertainty
        undecided = check.outcome is Outcome.INCONCLUSIVE
        # By how parts differ, of which a deck has one each.
        undecided |= check.name == "steady_state" and verdict.spread is not None
        if value is None or uncertainty is None or undecided or check.name not in NETWORK:
            continue
        true = _of_the_network(check.name, verdict, truth)
        yield check.name, value, uncertainty, true, check.unit
    for channel, known in zip(verdict.measurements.channels, truth.channels, strict=True):
        for name, reading in channel.readings.items():
            if reading is not None:
                label, true = f"{name} of u_{channel.index + 1}", known.get(name, math.nan)
                yield label, reading.value, reading.uncertainty, true, READINGS[name].unit


def _allowed(scene: Scene, name: str) -> float:
    """Return the error that the scene allows for a number, as a fraction.

    An error of the transient moves the instant of a level by its share of the distance to the
    target.
    """
    error, tolerance = scene.analysis.error, scene.checks.steady_state.tolerance
    if name == "steady_state":
        return tolerance
    wanted = SHARE * max(tolerance, LEAST_TOLERANCE)
    if isinstance(error, float):
        wanted = max(wanted, error)
    if name.startswith("settling_time"):
        return wanted / scene.checks.settling_time.band
    return wanted / LAST_LEVEL if name.startswith("rise_time") else wanted


def wrong_checks(verdict: Verdict, truth: TrueValues) -> Iterator[str]:
    """Yield the decided checks whose outcome contradicts the true value, with both."""
    for check in verdict.checks:
        right = _right_outcome(check, verdict, truth)
        if right is Outcome.PASS and check.name in RESTING and verdict.spread is not None:
            continue
        if right is not None and check.outcome not in (right, Outcome.INCONCLUSIVE):
            yield f"{check.name} is {check.outcome.value}, the truth is {right.value}"


def _right_outcome(check: Check, verdict: Verdict, truth: TrueValues) -> Outcome | None:
    """Return the outcome of a check by the true values; None if they do not decide it."""
    limits: Any = getattr(verdict.scene.checks, check.name, None)
    if check.name == "stability":
        stable = truth.rightmost[0] < 0.0
        if limits.margin > 1.0 and stable:
            return None if truth.margin is None else PASSED[truth.margin >= limits.margin]
        return PASSED[stable]
    if check.name not in NETWORK or not truth.amplitude:
        return None
    if truth.rightmost[0] >= 0.0 or not truth.arrives:
        return None if check.name == "rise_time" else Outcome.FAIL
    if check.name == "steady_state":
        return PASSED[truth.steady_state <= limits.tolerance]
    if not truth.readable:
        return None
    value = _of_the_network(check.name, verdict, truth)
    if math.isnan(value):
        return Outcome.FAIL
    lowest = getattr(limits, "min", None) or 0.0
    highest = math.inf if limits.max is None else limits.max
    return PASSED[lowest <= value <= highest]


def _of_the_network(name: str, verdict: Verdict, truth: TrueValues) -> float:
    """Return the true value of a check; NaN if there is none."""
    if name == "steady_state":
        return truth.steady_state
    if name == "rise_time":
        limits = verdict.scene.checks.rise_time
        if limits is not None and limits.channel is not None:
            return truth.channels[limits.channel - 1].get(name, math.nan)
    if name == "settling_time" and not all(name in channel for channel in truth.channels):
        return math.nan
    return max((c[name] for c in truth.channels if name in c), default=math.nan)


VERSIONS = ("taction", "numpy", "scipy", "ngspice")
STOPPED = "interrupted"
NO_NGSPICE = "ngspice was not found, or it is too old; see docs/install.md"


class CaseJudgement(enum.Enum):
    """Whether taction was right on a case."""

    RIGHT = "right"
    WRONG_OUTCOME = "wrong outcome"
    WRONG_NUMBER = "wrong number"
    NOT_RUN = "not run"


@dataclass(frozen=True, slots=True)
class CaseRun:
    """One case on one engine, and every stated number with its true value."""

    DOCUMENT = (
        *("case = case.name", "family = case.family", "engine"),
        "why = case.why # what makes the case hard",
        "known = case.known # how the true values are known",
        *("judgement", "outcome", "right_outcomes", "reason", "seconds [s]"),
        *("checks", "numbers = comparisons"),
    )

    case: Case
    engine: str
    outcome: str  # of the verdict, or the name of the exception; "-" without either
    judgement: CaseJudgement
    checks: tuple[Check, ...] = ()  # of a refused scene none
    comparisons: tuple[TruthComparison, ...] = ()
    reason: str = ""  # what is wrong, or why the scene was refused
    seconds: float = 0.0  # wall time

    @property
    def right_outcomes(self) -> tuple[str, ...]:
        """Those of the case on this engine."""
        return tuple(self.case.outcome[self.engine])

    @property
    def worst(self) -> TruthComparison | None:
        """The number with the largest true over stated error, or one without a true value."""
        each = self.comparisons
        return max(each, key=lambda one: (math.isnan(one.ratio), one.ratio), default=None)

    @property
    def outside(self) -> int:
        """How many true values are outside the stated uncertainty."""
        return sum(comparison.outside for comparison in self.comparisons)


@dataclass(frozen=True, slots=True)
class StressReport(Result):
    """The runs of all cases; `versions` are those of the programs that were used."""

    VIEW = "taction.verification.report.views.evidence_view:stress_view"
    DOCUMENT = ("runs", "count", "numbers", "outside", "versions")

    runs: tuple[CaseRun, ...]
    versions: dict[str, str]

    @property
    def wrong(self) -> tuple[CaseRun, ...]:
        """Runs with a wrong outcome or a wrong number."""
        fine = (CaseJudgement.RIGHT, CaseJudgement.NOT_RUN)
        return tuple(run for run in self.runs if run.judgement not in fine)

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the run before its last case."""
        return any(run.reason == STOPPED for run in self.runs)

    @property
    def exit_status(self) -> int:
        """0 all right, 1 an outcome or a number is wrong, 3 a case was not run."""
        if self.interrupted:
            return INTERRUPTED
        if self.wrong:
            return 1
        return 3 if any(run.judgement is CaseJudgement.NOT_RUN for run in self.runs) else 0

    @property
    def numbers(self) -> int:
        """How many stated numbers have a true value."""
        return sum(len(run.comparisons) for run in self.runs)

    @property
    def outside(self) -> int:
        """How many of them differ from it by more than their stated error."""
        return sum(run.outside for run in self.runs)

    def count(self) -> dict[str, int]:
        """Return the number of runs by judgement, without zeros."""
        found = [run.judgement for run in self.runs]
        return {kind.value: found.count(kind) for kind in CaseJudgement if kind in found}


def stress(
    *, only: Sequence[str] = (), jobs: int | None = None, progress: Progress = lambda stage: None
) -> StressReport:
    """Verify the catalogue of stiff and extreme scenes, whose right results are known.

    Every outcome is compared with the right outcome, and every number with its true value, if it is
    at hand: a checkout has the true values, an installed taction only the outcomes. So a run
    shows whether ngspice and the numerical libraries of this machine give right answers. Numbers
    outside their stated uncertainty are counted; a number is wrong that misses its true value by
    more than the uncertainty and the accuracy that the scene asks for.

    Parameters
    ----------
    only : sequence of str
        Run one case, or one family; repeatable.
    jobs : int, optional
        Number of processes; by default one per core.
    progress : callable, optional
        Receives the number of cases, then each run.

    Returns
    -------
    StressReport
        Every run with its judgement; `wrong` are those with a wrong outcome or number.

    Raises
    ------
    InputError
        There is no such case or family.
    Interrupted
        Ctrl-C; its `result` has the finished cases.

    Examples
    --------
    >>> import taction
    >>> len(taction.stress(only=["nothing-moves"], jobs=1).wrong)
    0
    """
    cases = select(load_catalogue(), tuple(only))
    progress(Notice(f"cases: {len(cases)}"))
    machine = describe_machine()
    calls = [(case, engine) for case in cases for engine in case.outcome]
    names = [f"{case.name}, {engine}" for case, engine in calls]
    runs = for_each(run_case, calls, names, _without, jobs=jobs, progress=progress)
    report = StressReport(tuple(runs), {name: str(machine[name]) for name in VERSIONS})
    if report.interrupted:
        raise Interrupted("the finished cases are in the report", report)
    return report


def _without(error: BaseException | None, reason: str, case: Case, engine: str) -> CaseRun:
    judgement = CaseJudgement.NOT_RUN if error is None else CaseJudgement.WRONG_OUTCOME
    return CaseRun(case, engine, "-", judgement, reason=reason or STOPPED)


def run_case(case: Case, engine: str) -> CaseRun:
    """Verify one case with one engine and judge the verdict, or the exception."""
    began = time.perf_counter()
    try:
        verdict = verify(case.scene(engine))
    except (SimulatorNotFound, SimulatorTooOld):
        return CaseRun(case, engine, "-", CaseJudgement.NOT_RUN, reason=NO_NGSPICE)
    except Exception as error:
        # Also an exception that taction does not raise on purpose is an outcome, a wrong one.
        seconds, name = time.perf_counter() - began, type(error).__name__
        right = name in case.outcome[engine]
        judgement = CaseJudgement.RIGHT if right else CaseJudgement.WRONG_OUTCOME
        return CaseRun(case, engine, name, judgement, reason=str(error), seconds=seconds)
    seconds, mistakes = time.perf_counter() - began, _wrong_outcomes(case, engine, verdict)
    numbers = () if case.truth is None else compare(verdict, case.truth)
    judgement = CaseJudgement.WRONG_OUTCOME if mistakes else CaseJudgement.RIGHT
    if wrong := [number.name for number in numbers if number.wrong]:
        judgement = CaseJudgement.WRONG_NUMBER
        mistakes.append(f"wrong: {', '.join(wrong)}")
    words = verdict.outcome.value, judgement, verdict.checks, numbers, "; ".join(mistakes)
    return CaseRun(case, engine, *words, seconds)


def _wrong_outcomes(case: Case, engine: str, verdict: Verdict) -> list[str]:
    """Return what differs from the right outcomes, with the reasons of the checks."""
    found = {c.name: f"{c.outcome.value}: {c.reason}" for c in verdict.checks}
    wrong = []
    if verdict.outcome.value not in case.outcome[engine]:
        reasons = "; ".join(f"{name} {text}" for name, text in found.items())
        words = " or ".join(case.outcome[engine])
        wrong.append(f"{verdict.outcome.value} instead of {words} ({reasons})")
    for name, right in case.decided.items():
        if not (now := found.get(name, "missing")).startswith(f"{right}:"):
            wrong.append(f"{name} must be {right}, is {now}")
    return wrong + ([] if case.truth is None else list(wrong_checks(verdict, case.truth)))
