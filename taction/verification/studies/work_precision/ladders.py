"""Run the ladders of a work-precision study within a time budget.

The coarse settings of all methods run first, then the finer settings. The rest of the budget is for
repeated runs, the fastest first. A run that exceeds its time limit is a result, too.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

from taction.verification.studies.running.worker import FAILURES, Worker
from taction.verification.studies.work_precision.methods import Method, MethodRun, MethodTask

REPEATS = 3
SHARE = 0.5  # of the remaining time that one run may take
MIN_LIMIT = 0.05  # s; no run starts with a shorter time limit
HEADROOM = 1.5  # expected time of a repeated run over that of the first run


@dataclass(slots=True, eq=False)
class SettingRuns:
    """The runs of one setting of one method."""

    method: Method
    setting: float
    run: MethodRun | None = None  # the first run, if it succeeded
    seconds: list[float] = field(default_factory=list)  # wall times; the limit after a time-out
    status: str = "done"  # or "timeout" or "failed"
    note: str = ""  # message of the error

    @property
    def name(self) -> str:
        """The setting in words."""
        return f"{self.setting:g} {self.method.setting}".strip() if self.method.setting else "-"


def run_ladders(
    task: MethodTask,
    methods: Sequence[Method],
    seconds: float,
    worker: Worker,
    progress: Callable[[str], None],
) -> tuple[list[SettingRuns], list[str]]:
    """Run every setting of `methods` for which there is time in `seconds`.

    Returns
    -------
    entries : list of SettingRuns
        In the order of `methods` and of their ladders.
    omissions : list of str
        Settings that were not run, and why.
    """
    end = clock.perf_counter() + seconds
    entries: dict[tuple[str, float], SettingRuns] = {}
    stopped: dict[str, str] = {}
    for method, setting in _schedule(methods):
        if method.name in stopped:
            continue
        limit = SHARE * (end - clock.perf_counter())
        if limit < MIN_LIMIT:
            stopped[method.name] = "the budget was used up"
            continue
        entry = SettingRuns(method, setting)
        progress(f"{method.name}, {entry.name}")
        _run_once(task, entry, limit, worker)
        entries[method.name, setting] = entry
        if entry.status == "timeout":
            stopped[method.name] = "the setting before timed out"
    _repeat(task, list(entries.values()), end, worker, progress)
    ordered = [
        entries[method.name, setting]
        for method in methods
        for setting in method.ladder
        if (method.name, setting) in entries
    ]
    return ordered, _not_run(methods, entries, stopped)


def _schedule(methods: Sequence[Method]) -> Iterator[tuple[Method, float]]:
    """Yield method and setting: the coarsest of each method, then the others, coarse to fine.

    The board's come first at the start, since a study without them answers nothing; then the cheap
    ideal network.
    """
    for problem in ("board", "ideal"):
        yield from ((m, m.ladder[0]) for m in methods if m.problem == problem)
    for problem in ("ideal", "board"):
        ladders = [[(m, s) for s in m.ladder[1:]] for m in methods if m.problem == problem]
        for level in zip_longest(*ladders):
            yield from (pair for pair in level if pair is not None)


def _run_once(task: MethodTask, entry: SettingRuns, limit: float, worker: Worker) -> None:
    """Run a setting once and store the run or its error in `entry`."""
    method = entry.method
    try:
        if method.engine == "ngspice":  # starts its own process
            run = method.run(task, entry.setting, limit)
        else:
            run = worker.call(limit, method.run, task, entry.setting)
    except TimeoutError as error:
        if entry.run is None:
            entry.status, entry.note = "timeout", str(error)
            entry.seconds.append(limit)
        return
    except FAILURES as error:
        entry.status, entry.note = "failed", f"{type(error).__name__}: {error}".splitlines()[0]
        return
    entry.run = entry.run or run
    entry.seconds.append(run.seconds)


def _repeat(
    task: MethodTask,
    entries: list[SettingRuns],
    end: float,
    worker: Worker,
    progress: Callable[[str], None],
) -> None:
    done = sorted((entry for entry in entries if entry.run), key=lambda entry: entry.seconds[0])
    for repeat in range(2, REPEATS + 1):
        for entry in done:
            left = end - clock.perf_counter()
            if HEADROOM * entry.seconds[0] < left:
                progress(f"{entry.method.name}, {entry.name}, run {repeat} of {REPEATS}")
                _run_once(task, entry, left, worker)


def _not_run(
    methods: Sequence[Method],
    entries: dict[tuple[str, float], SettingRuns],
    stopped: dict[str, str],
) -> list[str]:
    omissions = []
    for method in methods:
        missing = [f"{s:g}" for s in method.ladder if (method.name, s) not in entries]
        if missing:
            settings = f", {method.setting} {', '.join(missing)}" if method.setting else ""
            omissions.append(f"{method.name}{settings}: not run, {stopped[method.name]}")
    return omissions
