"""Run the catalogue of stress cases and judge outcomes and numbers."""

from __future__ import annotations

import enum
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from taction.system.errors import INTERRUPTED, Interrupted, SimulatorNotFound, SimulatorTooOld
from taction.system.progress import Notice, Progress
from taction.system.results import Result
from taction.verification.evidence.stress.catalogue import Case, load_catalogue, select
from taction.verification.evidence.stress.judge import TruthComparison, compare, worst, wrong_checks
from taction.verification.studies.running.study import for_each_file
from taction.verification.studies.running.versions import describe_machine
from taction.verification.verdict.checks import Check
from taction.verification.verdict.verify import Verdict, verify

VERSIONS = ("taction", "numpy", "scipy", "ngspice")
STOPPED = "interrupted"
NO_NGSPICE = "ngspice was not found, or it is too old; `taction self doctor` says more"


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
        """The stated number with the largest true error over its stated error."""
        return worst(self.comparisons)

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
    calls = [(case, engine) for case in cases for engine in case.engines]
    names = [Path(f"{case.name}, {engine}") for case, engine in calls]
    found = for_each_file(_run_named, names, calls, jobs=jobs, progress=progress)
    runs = tuple(
        run
        if isinstance(run, CaseRun)
        else CaseRun(*call, "-", CaseJudgement.NOT_RUN, reason=STOPPED)
        if run is None
        else CaseRun(*call, "-", CaseJudgement.WRONG_OUTCOME, reason="its process was killed")
        for call, run in zip(calls, found, strict=True)
    )
    report = StressReport(runs, {name: str(machine[name]) for name in VERSIONS})
    if report.interrupted:
        raise Interrupted("the finished cases are in the report", report)
    return report


def _run_named(_: Path, case: Case, engine: str) -> CaseRun:
    return run_case(case, engine)


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
