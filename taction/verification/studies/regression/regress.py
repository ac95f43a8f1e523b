"""Verify every scene of a folder and compare the results with a stored baseline.

The baseline is a JSON file with one entry per scene. Nothing in it depends on the time of the run,
so the same results give the same bytes.
"""

from __future__ import annotations

import enum
import json
import math
import time
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

from taction.netlist_gen.scene.check_keys import Regression
from taction.netlist_gen.scene.keys import files_of, scene_text
from taction.netlist_gen.scene.scene import Scene
from taction.system.charts import thinned
from taction.system.documents import INLINE, OPTIONAL, plain, read
from taction.system.errors import INTERRUPTED, Complaint, InputError, Interrupted, TactionError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.output_files import check_folder, printable, write_atomically
from taction.system.progress import Progress
from taction.system.reading_definitions import READINGS
from taction.system.results import Result
from taction.verification.studies.running.study import for_each
from taction.verification.studies.running.versions import file_content
from taction.verification.studies.scene_files import find_scenes, verdict_of
from taction.verification.verdict.checks import Check, Outcome, causes
from taction.verification.verdict.record import (
    POLE_READINGS,
    Difference,
    Figure,
    Record,
    Tolerance,
    compare,
)
from taction.verification.verdict.verify import Verdict

FORMAT = 6
POINTS = 120  # of the curve of a channel
MARK = "taction_baseline"
MOVE_AWAY = "rename it, and `--update` writes a new baseline"

ALWAYS = ("step_amplitude", "growth_rate", "frequency", "margin")
STABLE = ("settling_time",)  # of a stable board: the record of another one grows from rounding
CHANNEL_ALWAYS = ("reference",)
CHANNEL_STABLE = ("final", *READINGS)


@dataclass(frozen=True, slots=True)
class Entry:
    """The stored results of one scene."""

    name: str
    keys: dict[str, str]  # what the scene gives, see `keys_of`
    taction: str  # version
    solved_by: str  # engine with its version, matrix solver and integration method
    # What is compared: `ALWAYS`, `STABLE` and the same of the channels.
    record: Annotated[Record, INLINE]
    # Some instants, s, and the output at these, V, of each channel of a stable board, as texts of
    # numbers. A report draws them, and nothing compares them; older baselines have none.
    curves: Annotated[tuple[tuple[str, str], ...] | None, OPTIONAL] = None

    def __post_init__(self) -> None:
        if self.record.value("growth_rate") is None:
            raise ValueError("growth_rate is missing")
        for curve in self.curves or ():
            if len({len([*map(float, text.split())]) for text in curve}) != 1:
                raise ValueError("curves: expected as many outputs as instants")

    @property
    def stable(self) -> bool:
        """Whether the board has no growing mode."""
        return (self.record.value("growth_rate") or 0.0) < 0.0

    @property
    def checks(self) -> dict[str, str]:
        """Outcomes by the names of the checks."""
        return {check.name: check.outcome.value for check in self.record.checks}


Baseline = Mapping[str, Entry]
"""Entries by the name of the scene's file."""


def observe(verdict: Verdict) -> Entry:
    """Return the entry of a verdict."""
    return Entry(
        name=verdict.scene.name,
        keys=keys_of(verdict.scene),
        taction=metadata.version("taction"),
        solved_by=verdict.waveforms.simulator,
        record=Record.of(verdict).without_run_time(),
        curves=tuple(_curves(verdict)) if verdict.poles.known_stable else None,
    )


def _curves(verdict: Verdict) -> Iterator[tuple[str, str]]:
    for column in verdict.u.T:
        x, y = thinned(verdict.waveforms.time, column, POINTS)
        yield " ".join(f"{t:.4g}" for t in x.tolist()), " ".join(f"{u:.4g}" for u in y.tolist())


def keys_of(scene: Scene) -> dict[str, str]:
    """Return the keys that a scene gives, without its tolerances, and the SHA-256 of its files."""
    found = dict(_flat(tomllib.loads(scene_text(scene))))
    named = {path: name for path, name in files_of(scene).items() if isinstance(name, str)}
    found |= {path: f"{name} {file_content(scene, name).hex()}" for path, name in named.items()}
    return {path: text for path, text in found.items() if not path.startswith("regression.")}


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in table.items():
        path = f"{prefix}{name}"
        yield from _flat(value, f"{path}.") if isinstance(value, dict) else [(path, str(value))]


def load_baseline(path: str | Path) -> dict[str, Entry]:
    """Read the entries of a baseline, or refuse a file that is none, or that is damaged."""

    def unusable(key: str, value: str, reason: str) -> InputError:
        return InputError(path, Complaint(key, value, reason))

    damaged = f"; restore the file, or {MOVE_AWAY}"
    try:
        data = json.loads(read_bounded(Path(path), LARGEST))
    except UnusableFileError as error:
        raise unusable("baseline", "", f"{error}; `--update` writes a baseline") from None
    except (ValueError, RecursionError) as error:
        raise unusable("baseline", "", f"damaged, no JSON: {error}{damaged}") from None
    if not isinstance(data, dict) or MARK not in data:
        reason = f"JSON, but no baseline of taction ('{MARK}' is missing); give another file"
        raise unusable("baseline", "", reason)
    if data[MARK] != FORMAT:
        reason = f"another format; this taction reads {FORMAT}. Use the taction that wrote it, or "
        raise unusable(MARK, repr(data[MARK]), reason + MOVE_AWAY)
    try:
        entries = {"scenes": data.get("scenes")}
        found = read(dict[str, dict[str, Entry]], entries)["scenes"]
        if json.loads(baseline_text(found)) != data:
            raise ValueError("scenes: has a key that no baseline has, or lacks one")
    except ValueError as error:
        place, _, what = str(error).rpartition(": ")
        raise unusable(place or "scenes", "", f"damaged: {what}{damaged}") from None
    return found


def baseline_text(entries: Baseline) -> str:
    """Return a baseline as the text of its file."""
    file = {MARK: FORMAT, "scenes": dict(sorted(entries.items()))}
    return json.dumps(plain(file), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def compare_entry(entry: Entry, then: Entry, allowed: Regression) -> tuple[Difference, ...]:
    """Compare a scene's results with its entry in the baseline, which is the first of both.

    Checks that only one of them ran do not count; of a board that became stable or unstable only
    poles, and of an unstable one no transient: it grows from rounding.
    """
    same, stable = entry.stable == then.stable, entry.stable and then.stable
    common = then.checks.keys() & entry.checks.keys()
    found = compare(
        then.record,
        entry.record,
        scene_tolerance(allowed, then),
        groups=("checks", "states", "figures") + ("channels",) * same,
        figures=(*ALWAYS[1:], *STABLE * stable),
        channel_figures=CHANNEL_ALWAYS + CHANNEL_STABLE * stable,
    )
    return tuple(each for each in found if each.group != "checks" or each.name in common)


def scene_tolerance(allowed: Regression, then: Entry) -> Tolerance:
    """Return the tolerances of a scene: of voltages in step amplitudes, of poles in magnitudes."""
    amplitude = then.record.value("step_amplitude") or 0.0

    def tolerance(name: str, first: Figure, second: Figure) -> float | None:
        size, unit = abs(first.value or 0.0), first.unit
        if name in POLE_READINGS:
            scale = abs(complex(*then.record.pole or ())) if unit else 1.0
            return allowed.poles.absolute * scale + allowed.poles.relative * size
        if unit == "s":
            return allowed.times.absolute + allowed.times.relative * size
        scale = amplitude if unit == "V" else 1.0
        return allowed.levels.absolute * scale + allowed.levels.relative * size

    return tolerance


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
class SceneResult:
    """Comparison of one scene with its baseline."""

    DOCUMENT = (
        *("file", "status", "outcome = entry.record.outcome", "reason", "notes"),
        *("simulator = entry.solved_by", "baseline.outcome = baseline.record.outcome"),
        *("baseline.taction = baseline.taction", "baseline.simulator = baseline.solved_by"),
        "baseline.keys = baseline.keys",
        *("worst # of the differences, over what is allowed", "checks"),
        *("differences # the baseline is the first", "seconds [s]"),
    )

    file: str  # name in the folder
    status: Status
    checks: tuple[Check, ...] = ()
    differences: tuple[Difference, ...] = ()
    notes: tuple[str, ...] = ()  # possible explanations of the differences
    reason: str = ""  # why it does not pass: failed checks with value and limit, or an error
    entry: Entry | None = None
    baseline: Entry | None = None
    seconds: float = 0.0  # wall time of the verification

    @property
    def changes(self) -> tuple[Difference, ...]:
        """Differences above their tolerance, the largest first, with the causes of checks."""
        notes = dict[str, str]()
        for found in causes(self.checks):
            notes |= dict.fromkeys((found.check, *found.follows), found.text)
        changed = (
            replace(d, note=notes.get(d.name, "")) if d.group == "checks" else d
            for d in self.differences
            if d.beyond
        )
        return tuple(sorted(changed, key=lambda d: -d.off))

    @property
    def worst(self) -> float | None:
        """Largest difference, in tolerances; None without differences."""
        return max((d.off for d in self.differences), default=None)

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
    """Comparison of a folder with its baseline."""

    VIEW = "taction.verification.report.views.comparison_view:regression_view"
    DOCUMENT = (
        *("exit_status", "folder", "baseline", "updated", "interrupted"),
        *("counts = count", "scenes = results"),
    )

    folder: str
    baseline: str
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

    @property
    def left(self) -> tuple[str, ...]:
        """The scenes that an update leaves as they were, since a check fails."""
        return tuple(each.file for each in self.results if self.updated and each.failed)

    def count(self) -> dict[str, int]:
        """Return the number of scenes by status, without zeros."""
        statuses = [result.status for result in self.results]
        return {status.value: statuses.count(status) for status in Status if status in statuses}


def regress(
    folder: str | Path,
    *,
    baseline: str | Path,
    update: bool = False,
    jobs: int | None = None,
    progress: Progress = lambda stage: None,
) -> RegressionReport:
    """Verify every scene (``*.toml``) in DIR and compare the results with the baseline.

    Parameters
    ----------
    folder : path
        Folder of the scenes.
    baseline : path
        Stored results (JSON).
    update : bool
        Write changed results into the baseline; scenes that fail stay as they were.
    jobs : int, optional
        Number of processes; by default one per core.
    progress : callable, optional
        Receives the number of finished scenes.

    Returns
    -------
    RegressionReport
        The status of every scene, and what differs.

    Raises
    ------
    InputError
        The folder holds no scene, or the baseline cannot be used.
    Interrupted
        Ctrl-C; its `result` has the finished scenes.

    Examples
    --------
    >>> import taction, tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     text = Path("scenes/tuned-breadboard.toml").read_text()
    ...     made = Path(folder, "a.toml").write_text(text)
    ...     file = Path(folder, "baseline.json")
    ...     first = taction.regress(folder, baseline=file, update=True, jobs=1)
    ...     taction.regress(folder, baseline=file, jobs=1).count()
    {'same': 1}
    """
    check_folder(str(baseline), "--baseline")
    fresh = update and not Path(baseline).exists()
    entries, files = {} if fresh else load_baseline(baseline), find_scenes(folder)
    names = [printable(path.name) for path in files]
    calls = [(path, entries.get(name)) for path, name in zip(files, names, strict=True)]
    stems = [path.stem for path in files]
    results = for_each(compare_scene, calls, stems, _without, jobs=jobs, progress=progress)
    reason = "in the baseline, but not in the folder"
    gone = sorted(set(entries) - set(names))
    results += [SceneResult(n, Status.MISSING, reason=reason, baseline=entries[n]) for n in gone]
    report = RegressionReport(str(folder), str(baseline), tuple(results), update)
    if update:
        write_atomically(baseline, baseline_text(updated_baseline(report, entries)))
    if report.interrupted:
        raise Interrupted("the finished scenes are in the report", report)
    return report


def compare_scene(path: Path, then: Entry | None) -> SceneResult:
    """Verify one scene and compare it with its entry; bad input gives a result, too."""
    started, file, verdict = time.perf_counter(), printable(path.name), verdict_of(path)
    if isinstance(verdict, TactionError):
        status = Status.BAD_INPUT if isinstance(verdict, InputError) else Status.NO_VERDICT
        seconds = time.perf_counter() - started
        return SceneResult(file, status, reason=str(verdict), baseline=then, seconds=seconds)
    now = observe(verdict)
    differences = () if then is None else compare_entry(now, then, verdict.scene.regression)
    changed = any(difference.beyond for difference in differences)
    status, seconds = _status(verdict.outcome, then, changed), time.perf_counter() - started
    notes = () if then is None else tuple(_notes(now, then))
    reason, checks = "; ".join(found.text for found in causes(verdict.checks)), verdict.checks
    return SceneResult(file, status, checks, differences, notes, reason, now, then, seconds)


def _without(error: BaseException | None, reason: str, path: Path, _: Entry | None) -> SceneResult:
    status = Status.NOT_RUN if error is None else Status.NO_VERDICT
    return SceneResult(printable(path.name), status, reason=reason or "interrupted")


def updated_baseline(report: RegressionReport, baseline: Baseline) -> dict[str, Entry]:
    """Return the entries of the updated baseline.

    An unchanged scene keeps its entry, so small changes cannot add up; it gets the curves that an
    older taction did not store. A scene that fails or has no verdict is left as it was, or out.
    """
    entries = {}
    for result in report.results:
        old, new = baseline.get(result.file), result.entry
        keep = new is None or result.failed or result.status in KEPT or _unchanged(result)
        if old is not None and new is not None and old.curves is None and _unchanged(result):
            old = replace(old, curves=new.curves)
        if result.status is not Status.MISSING and (chosen := old if keep else new) is not None:
            entries[result.file] = chosen
    return entries


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
    if new is None or old is None or math.isinf(result.worst or 0.0):
        return False
    same = new.record.outcome == old.record.outcome and new.checks == old.checks
    return same and new.keys == old.keys and not result.changes


def _notes(now: Entry, then: Entry) -> Iterable[str]:
    for key in {**then.keys, **now.keys}:
        if (was := then.keys.get(key, "not given")) != (given := now.keys.get(key, "not given")):
            yield f"edited since the baseline: {key} was {was}, now {given}"
    if now.solved_by != then.solved_by:
        yield f"simulator was {then.solved_by}, now {now.solved_by}"
    if now.taction != then.taction:
        yield f"taction was {then.taction}, now {now.taction}"
    if removed := sorted(set(then.checks) - set(now.checks)):
        yield f"{', '.join(removed)} ran for the baseline, not now"
    if added := sorted(set(now.checks) - set(then.checks)):
        yield f"{', '.join(added)} is not in the baseline"
