"""Every scene of a folder verified and compared with a stored baseline."""

from __future__ import annotations

import enum
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from netlist_gen.scene.file import load_scene
from spice_models.errors import Complaint, InputError, NoVerdictError
from verification.pipeline.checks import Check, Outcome
from verification.studies.regression.baseline import Baseline, Entry, git_revision
from verification.studies.regression.baseline_entry import observe
from verification.studies.regression.compare import Difference, compare
from verification.verify import Verdict, verify

INTERRUPTED = 130  # what a shell reports for a process that Ctrl-C ended


class Status(enum.Enum):
    """What became of a scene since the baseline."""

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
KEPT = (Status.NO_VERDICT, Status.BAD_INPUT, Status.NOT_RUN)  # an update leaves their entries


@dataclass(frozen=True, slots=True)
class SceneResult:
    """One scene of the folder, or of the baseline.

    Attributes
    ----------
    file : str
        Name in the folder.
    status : Status
        What became of it.
    checks : tuple of Check
        Of its verdict; empty where there is none.
    differences : tuple of Difference
        Every quantity beside its baseline.
    notes : tuple of str
        What may explain a difference.
    reason : str
        Why there is no verdict, or empty.
    entry, baseline : Entry or None
        What it gave now, and then.
    seconds : float
        Wall time of its verification, s.
    """

    file: str
    status: Status
    checks: tuple[Check, ...] = ()
    differences: tuple[Difference, ...] = ()
    notes: tuple[str, ...] = ()
    reason: str = ""
    entry: Entry | None = None
    baseline: Entry | None = None
    seconds: float = 0.0

    @property
    def changes(self) -> tuple[Difference, ...]:
        """The differences above their tolerance, the largest first; what must be equal leads."""
        changed = (d for d in self.differences if d.changed)
        return tuple(sorted(changed, key=lambda d: -d.off))

    @property
    def worst(self) -> float:
        """Largest difference, in tolerances."""
        return max((d.off for d in self.differences), default=0.0)

    @property
    def fails(self) -> bool:
        """Whether a check failed or something changed."""
        failed = any(check.outcome is Outcome.FAIL for check in self.checks)
        return failed or self.status in FAILURES


@dataclass(frozen=True, slots=True)
class RegressionReport:
    """A folder compared with its baseline; `revision` is the commit that is checked out."""

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
        """0 pass, 1 a check failed or something changed, 2 bad input, 3 no verdict.

        A change that was just written to the baseline is none any more; a failed check is.
        """
        statuses = {result.status for result in self.results}
        if self.interrupted:
            return INTERRUPTED
        if Status.BAD_INPUT in statuses:
            return 2
        if any(_fails(result, self.updated) for result in self.results):
            return 1
        return 3 if Status.NO_VERDICT in statuses else 0

    def count(self) -> dict[str, int]:
        """Return how many scenes there are of each status that occurs."""
        found = [result.status for result in self.results]
        return {status.value: found.count(status) for status in Status if status in found}


def find_scenes(folder: str | Path) -> tuple[Path, ...]:
    """Return the ``*.toml`` files of `folder`, by name.

    Raises
    ------
    InputError
        It is no folder, or holds none.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(folder, Complaint("DIR", "", "no such folder; expected one with scenes"))
    files = tuple(sorted(path for path in folder.glob("*.toml") if path.is_file()))
    if not files:
        raise InputError(folder, Complaint("DIR", "", "holds no scene; expected *.toml files"))
    return files


def regress(
    folder: str | Path,
    baseline_file: str | Path,
    baseline: Baseline,
    *,
    updated: bool = False,
    progress: Callable[[str], None] = lambda stage: None,
) -> RegressionReport:
    """Verify every scene of `folder` and compare it with its entry of `baseline`.

    An interruption by Ctrl-C ends the run, not the report: what was not reached is `NOT_RUN`.

    Raises
    ------
    InputError
        See `find_scenes`.
    """
    files, revision = find_scenes(folder), git_revision(Path(folder))
    results: list[SceneResult] = []
    try:
        for place, path in enumerate(files, 1):
            progress(f"{place} of {len(files)}: {path.stem}")
            results.append(judge_scene(path, baseline.get(path.name), revision))
    except KeyboardInterrupt:
        left = files[len(results) :]
        results += [SceneResult(p.name, Status.NOT_RUN, (), (), (), "interrupted") for p in left]
    gone = sorted(set(baseline) - {path.name for path in files})
    results += [_missing(name, baseline[name]) for name in gone]
    return RegressionReport(str(folder), str(baseline_file), revision, tuple(results), updated)


def judge_scene(path: Path, then: Entry | None, revision: str) -> SceneResult:
    """Verify one scene and compare it with its entry; a failure is a result, not an exception."""
    begin = time.perf_counter()
    try:
        verdict = verify(load_scene(path))
    except InputError as error:
        return SceneResult(path.name, Status.BAD_INPUT, reason=str(error), baseline=then)
    except NoVerdictError as error:
        seconds = time.perf_counter() - begin
        return SceneResult(
            path.name, Status.NO_VERDICT, reason=str(error), baseline=then, seconds=seconds
        )
    return _judge(path.name, verdict, then, revision, time.perf_counter() - begin)


def updated_baseline(report: RegressionReport, baseline: Baseline) -> dict[str, Entry]:
    """Return the entries of a baseline brought up to date.

    A scene that is the same keeps its entry, so that the file changes only where a result did, and
    many small changes cannot add up unseen. A scene without a verdict keeps its entry too.
    """
    entries = {}
    for result in report.results:
        old, new = baseline.get(result.file), result.entry
        keep = new is None or result.status in KEPT or _as_before(result)
        chosen = old if keep else new
        if chosen is not None and result.status is not Status.MISSING:
            entries[result.file] = chosen
    return entries


def _judge(
    file: str, verdict: Verdict, then: Entry | None, revision: str, seconds: float
) -> SceneResult:
    now = observe(verdict, revision)
    differences = () if then is None else compare(now, then, verdict.scene.regression)
    changed = any(difference.changed for difference in differences)
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
    passed = then.outcome == Outcome.PASS.value
    if outcome is Outcome.FAIL:
        return Status.BROKEN if passed else Status.FAILING
    if not passed:
        return Status.NEWLY_PASSING
    return Status.CHANGED if changed else Status.SAME


def _missing(name: str, then: Entry) -> SceneResult:
    reason = "in the baseline, but not in the folder"
    return SceneResult(name, Status.MISSING, reason=reason, baseline=then)


def _fails(result: SceneResult, updated: bool) -> bool:
    if updated:
        return any(check.outcome is Outcome.FAIL for check in result.checks)
    return result.fails


def _as_before(result: SceneResult) -> bool:
    new, old = result.entry, result.baseline
    if new is None or old is None or math.isinf(result.worst):
        return False
    same = (new.fingerprint, new.outcome, new.checks) == (old.fingerprint, old.outcome, old.checks)
    return same and not result.changes


def _undecided(checks: Iterable[Check]) -> str:
    undecided = (check for check in checks if check.outcome is Outcome.INCONCLUSIVE)
    return "; ".join(f"{check.name}: {check.reason}" for check in undecided)


def _notes(now: Entry, then: Entry) -> Iterable[str]:
    if now.fingerprint != then.fingerprint:
        yield "the scene, or a file that it names, was edited since the baseline"
    for what, new, old in (
        ("simulator", now.simulator, then.simulator),
        ("taction", now.taction, then.taction),
    ):
        if new != old:
            yield f"{what} was {old}, now {new}"
    gone, came = set(then.checks) - set(now.checks), set(now.checks) - set(then.checks)
    for checks, text in ((gone, "ran for the baseline, not now"), (came, "is not in the baseline")):
        if checks:
            yield f"{', '.join(sorted(checks))} {text}"
