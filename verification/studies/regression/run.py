"""Verify every scene of a folder and compare the results with a stored baseline."""

from __future__ import annotations

import enum
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from taction.netlist_gen.scene.scene import load_scene
from taction.system.errors import INTERRUPTED, InputError, NoVerdictError
from taction.system.output_files import printable
from taction.system.results import Result
from taction.verification.studies.regression.baseline import (
    Baseline,
    Entry,
    git_revision,
    observe,
)
from taction.verification.studies.regression.compare import compare_entry
from taction.verification.studies.running.collecting import for_each_file
from taction.verification.studies.scene_files import find_scenes
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.compare import Difference
from taction.verification.verdict.verify import Verdict, verify


class Status(enum.Enum):
    """Status of a scene relative to the baseline."""

    SAME = "same"
    CHANGED = "changed"
    BROKEN = "broken"
    FAILING = "still failing"
    NEWLY_PASSING = "newly passing"
    NEW = "new"
    MISSING = "missing"
    NO_VERDICT = "no verdict"
    BAD_INPUT = "bad input"
    NOT_RUN = "not run"


FAILURES = (Status.CHANGED, Status.BROKEN, Status.FAILING, Status.MISSING)
KEPT = (Status.NO_VERDICT, Status.BAD_INPUT, Status.NOT_RUN)  # an update keeps their entries


@dataclass(frozen=True, slots=True)
class BaselineOrigin:
    """Where an entry of a baseline comes from."""

    outcome: str
    revision: str
    taction: str
    simulator: str
    fingerprint: str


@dataclass(frozen=True, slots=True)
class SceneResult:
    """Comparison of one scene with its baseline."""

    DOCUMENT = (
        *("file", "status", "outcome = entry.record.outcome", "reason", "notes"),
        *("simulator = entry.solved_by", "baseline = origin"),
        *("worst = worst_known # of the differences, over what is allowed", "checks"),
        *("differences # the baseline is the first", "seconds [s]"),
    )

    file: str  # name in the folder
    status: Status
    checks: tuple[Check, ...] = ()
    differences: tuple[Difference, ...] = ()
    notes: tuple[str, ...] = ()  # possible explanations of the differences
    reason: str = ""  # why there is no verdict
    entry: Entry | None = None
    baseline: Entry | None = None
    seconds: float = 0.0  # wall time of the verification

    @property
    def changes(self) -> tuple[Difference, ...]:
        """Differences above their tolerance, the largest first; infinite differences lead."""
        changed = (d for d in self.differences if d.beyond)
        return tuple(sorted(changed, key=lambda d: -d.off))

    @property
    def worst(self) -> float:
        """Largest difference, in tolerances."""
        return max((d.off for d in self.differences), default=0.0)

    @property
    def worst_known(self) -> float | None:
        """The same, or None without differences."""
        return self.worst if self.differences else None

    @property
    def origin(self) -> BaselineOrigin | None:
        """Where the entry of the baseline comes from."""
        then = self.baseline
        if then is None:
            return None
        known = then.revision, then.taction, then.solved_by, then.fingerprint
        return BaselineOrigin(then.record.outcome, *known)

    @property
    def failed(self) -> bool:
        """Whether a check failed."""
        return any(check.outcome is Outcome.FAIL for check in self.checks)

    @property
    def fails(self) -> bool:
        """Whether a check failed or a quantity changed."""
        return self.failed or self.status in FAILURES


@dataclass(frozen=True, slots=True)
class RegressionReport(Result):
    """Comparison of a folder with its baseline; `revision` is the commit that is checked out."""

    VIEW = "taction.verification.report.views.regression:view"
    DOCUMENT = (
        *("exit_status", "folder", "baseline", "revision", "updated", "interrupted"),
        *("counts = count", "scenes = results"),
    )

    folder: str
    baseline: str
    revision: str
    results: tuple[SceneResult, ...]
    updated: bool

    @property
    def interrupted(self) -> bool:
        """Whether the run was ended before its last scene."""
        return any(result.status is Status.NOT_RUN for result in self.results)

    @property
    def exit_status(self) -> int:
        """0 pass, 1 a check failed or a quantity changed, 2 bad input, 3 no verdict.

        After an update of the baseline only failed checks count.
        """
        statuses = {result.status for result in self.results}
        if self.interrupted:
            return INTERRUPTED
        if Status.BAD_INPUT in statuses:
            return 2
        if any(r.failed if self.updated else r.fails for r in self.results):
            return 1
        return 3 if Status.NO_VERDICT in statuses else 0

    def count(self) -> dict[str, int]:
        """Return the number of scenes by status, without zeros."""
        statuses = [result.status for result in self.results]
        return {status.value: statuses.count(status) for status in Status if status in statuses}


def regress(
    folder: str | Path,
    baseline_file: str | Path,
    baseline: Baseline,
    *,
    updated: bool = False,
    jobs: int | None = 1,
    progress: Callable[[str], None] = lambda stage: None,
) -> RegressionReport:
    """Verify every scene of `folder` and compare it with its entry of `baseline`.

    `jobs` is the number of processes, None for one a core; the results do not depend on it. After
    Ctrl-C the report has the remaining scenes as `NOT_RUN`.

    Raises
    ------
    InputError
        See `taction.verification.studies.scene_files.find_scenes`.
    NoVerdictError
        The processes do not start.
    """
    files, revision = find_scenes(folder), git_revision(Path(folder))
    names = [printable(path.name) for path in files]
    arguments = [(baseline.get(name), revision) for name in names]
    found = for_each_file(compare_scene, files, arguments, jobs=jobs, progress=progress)
    results = [_result(name, result) for name, result in zip(names, found, strict=True)]
    reason = "in the baseline, but not in the folder"
    results += [
        SceneResult(name, Status.MISSING, reason=reason, baseline=baseline[name])
        for name in sorted(set(baseline) - set(names))
    ]
    return RegressionReport(str(folder), str(baseline_file), revision, tuple(results), updated)


def _result(name: str, found: SceneResult | BaseException | None) -> SceneResult:
    """Return what was found for a scene, also if its process was killed or never began."""
    if found is None:
        return SceneResult(name, Status.NOT_RUN, reason="interrupted")
    if isinstance(found, BaseException):
        return SceneResult(name, Status.NO_VERDICT, reason=f"the process was killed: {found}")
    return found


def compare_scene(path: Path, then: Entry | None, revision: str) -> SceneResult:
    """Verify one scene and compare it with its entry; bad input gives a result, too."""
    started = time.perf_counter()
    try:
        verdict = verify(load_scene(path))
    except InputError as error:
        return SceneResult(printable(path.name), Status.BAD_INPUT, reason=str(error), baseline=then)
    except NoVerdictError as error:
        result = SceneResult(
            printable(path.name), Status.NO_VERDICT, reason=str(error), baseline=then
        )
        return replace(result, seconds=time.perf_counter() - started)
    return _compared(printable(path.name), verdict, then, revision, time.perf_counter() - started)


def updated_baseline(report: RegressionReport, baseline: Baseline) -> dict[str, Entry]:
    """Return the entries of the updated baseline.

    An unchanged scene keeps its entry, so many changes below the tolerance cannot add up from
    update to update. A scene without a verdict keeps its entry, too.
    """
    entries = {}
    for result in report.results:
        old, new = baseline.get(result.file), result.entry
        keep = new is None or result.status in KEPT or _unchanged(result)
        chosen = old if keep else new
        if chosen is not None and result.status is not Status.MISSING:
            entries[result.file] = chosen
    return entries


def _compared(
    file: str, verdict: Verdict, then: Entry | None, revision: str, seconds: float
) -> SceneResult:
    now = observe(verdict, revision)
    differences = () if then is None else compare_entry(now, then, verdict.scene.regression)
    changed = any(difference.beyond for difference in differences)
    return SceneResult(
        file=file,
        status=_status(verdict.outcome, then, changed),
        checks=verdict.checks,
        differences=differences,
        notes=() if then is None else tuple(_notes(now.entry, then)),
        reason=_undecided(verdict.checks),
        entry=now.entry,
        baseline=then,
        seconds=seconds,
    )


def _status(outcome: Outcome, then: Entry | None, changed: bool) -> Status:
    if outcome is Outcome.INCONCLUSIVE:
        return Status.NO_VERDICT
    if then is None:
        return Status.NEW
    passed = then.record.outcome == Outcome.PASS.value
    if outcome is Outcome.FAIL:
        return Status.BROKEN if passed else Status.FAILING
    if not passed:
        return Status.NEWLY_PASSING
    return Status.CHANGED if changed else Status.SAME


def _unchanged(result: SceneResult) -> bool:
    new, old = result.entry, result.baseline
    if new is None or old is None or math.isinf(result.worst):
        return False
    same = new.record.outcome == old.record.outcome and new.checks == old.checks
    return same and new.fingerprint == old.fingerprint and not result.changes


def _undecided(checks: Iterable[Check]) -> str:
    undecided = (check for check in checks if check.outcome is Outcome.INCONCLUSIVE)
    return "; ".join(f"{check.name}: {check.reason}" for check in undecided)


def _notes(now: Entry, then: Entry) -> Iterable[str]:
    if now.fingerprint != then.fingerprint:
        yield "the scene, or a file that it names, was edited since the baseline"
    versions = ("simulator", then.solved_by, now.solved_by), ("taction", then.taction, now.taction)
    for name, old, new in versions:
        if new != old:
            yield f"{name} was {old}, now {new}"
    if removed := sorted(set(then.checks) - set(now.checks)):
        yield f"{', '.join(removed)} ran for the baseline, not now"
    if added := sorted(set(now.checks) - set(then.checks)):
        yield f"{', '.join(added)} is not in the baseline"
