"""Runs the ladders of a work-precision study within a time budget.

Coarse settings of every method come first, then finer ones; what is left of the budget goes into
repeats, cheapest first. A run that uses up its time is a point of its own, not a gap.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from verification.studies.running.worker import FAILURES, Worker
from verification.studies.work_precision.method_runs import MethodRun, Task
from verification.studies.work_precision.methods import Method

REPEATS = 3
SHARE = 0.5  # of the time left that one run may use
LEAST = 0.05  # s; with less left nothing is started
HEADROOM = 1.5  # a repeat may take that much longer than the run before


@dataclass(slots=True, eq=False)
class SettingRuns:
    """What became of one setting of one method.

    Attributes
    ----------
    method : Method
        Of `METHODS`.
    setting : float
        Of its ladder.
    run : MethodRun or None
        The first run; None if it did not end well.
    seconds : list of float
        Wall time of every run; of one that timed out, the time it was given.
    status : str
        ``"done"``, ``"timeout"`` or ``"failed"``.
    note : str
        What went wrong.
    """

    method: Method
    setting: float
    run: MethodRun | None = None
    seconds: list[float] = field(default_factory=list)
    status: str = "done"
    note: str = ""

    @property
    def name(self) -> str:
        """The setting in words."""
        return f"{self.setting:g} {self.method.setting}".strip() if self.method.setting else "-"


def run_ladders(
    task: Task,
    methods: Sequence[Method],
    seconds: float,
    worker: Worker,
    progress: Callable[[str], None],
) -> tuple[list[SettingRuns], list[str]]:
    """Run every setting of `methods` as far as `seconds` reach.

    Returns
    -------
    entries : list of SettingRuns
        In the order of `methods` and of their ladders.
    omissions : list of str
        What was not run, and why.
    """
    end = clock.perf_counter() + seconds
    entries: dict[tuple[str, float], SettingRuns] = {}
    stopped: dict[str, str] = {}
    for method, setting in _schedule(methods):
        if method.name in stopped:
            continue
        left = end - clock.perf_counter()
        if SHARE * left < LEAST:
            stopped[method.name] = "the budget was used up"
            continue
        entry = SettingRuns(method, setting)
        progress(f"{method.name}, {entry.name}")
        _attempt(task, entry, SHARE * left, worker)
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
    """Yield what to run: the ideal network, which is cheap, then the board; coarse to fine."""
    for problem in ("ideal", "board"):
        mine = [method for method in methods if method.problem == problem]
        for rung in range(max((len(method.ladder) for method in mine), default=0)):
            for method in mine:
                if rung < len(method.ladder):
                    yield method, method.ladder[rung]


def _attempt(task: Task, entry: SettingRuns, allowed: float, worker: Worker) -> None:
    """Run a setting once and note what came of it."""
    method = entry.method
    try:
        if method.engine == "ngspice":  # a process of its own
            run = method.run(task, entry.setting, allowed)
        else:
            run = worker.call(allowed, method.run, task, entry.setting)
    except TimeoutError as error:
        if entry.run is None:
            entry.status, entry.note = "timeout", str(error)
            entry.seconds.append(allowed)
        return
    except FAILURES as error:
        entry.status, entry.note = "failed", f"{type(error).__name__}: {error}".splitlines()[0]
        return
    entry.run = entry.run or run
    entry.seconds.append(run.seconds)


def _repeat(
    task: Task,
    entries: list[SettingRuns],
    end: float,
    worker: Worker,
    progress: Callable[[str], None],
) -> None:
    for repeat in range(2, REPEATS + 1):
        for entry in sorted((t for t in entries if t.run), key=lambda t: t.seconds[0]):
            left = end - clock.perf_counter()
            if HEADROOM * entry.seconds[0] < left:
                progress(f"{entry.method.name}, {entry.name}, run {repeat} of {REPEATS}")
                _attempt(task, entry, left, worker)


def _not_run(
    methods: Sequence[Method],
    entries: dict[tuple[str, float], SettingRuns],
    stopped: dict[str, str],
) -> list[str]:
    omissions = []
    for method in methods:
        left = [s for s in method.ladder if (method.name, s) not in entries]
        if left:
            settings = ", ".join(f"{setting:g}" for setting in left)
            what = f"{method.name}, {method.setting} {settings}" if method.setting else method.name
            omissions.append(f"{what}: not run, {stopped[method.name]}")
    return omissions
