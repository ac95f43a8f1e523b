"""Runs the ladders of a work-precision study within a time budget.

Coarse settings of every method come first, then finer ones; what is left of the budget goes into
repeats, cheapest first. A run that uses up its time is a point of its own, not a gap.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from verification.studies.running.worker import FAILURES, Worker
from verification.studies.work_precision.method_runs import Run, Task
from verification.studies.work_precision.methods import Method

REPEATS = 3
SHARE = 0.5  # of the time left that one run may use
LEAST = 0.05  # s; with less left nothing is started
HEADROOM = 1.5  # a repeat may take that much longer than the run before


@dataclass(slots=True, eq=False)
class Tally:
    """What became of one setting of one method.

    Attributes
    ----------
    method : Method
        Of `METHODS`.
    setting : float
        Of its ladder.
    run : Run or None
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
    run: Run | None = None
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
) -> tuple[list[Tally], list[str]]:
    """Run every setting of `methods` as far as `seconds` reach.

    Returns
    -------
    tallies : list of Tally
        In the order of `methods` and of their ladders.
    omissions : list of str
        What was not run, and why.
    """
    end = clock.perf_counter() + seconds
    tallies: dict[tuple[str, float], Tally] = {}
    stopped: dict[str, str] = {}
    for method, setting in _schedule(methods):
        if method.name in stopped:
            continue
        left = end - clock.perf_counter()
        if SHARE * left < LEAST:
            stopped[method.name] = "the budget was used up"
            continue
        tally = Tally(method, setting)
        progress(f"{method.name}, {tally.name}")
        _attempt(task, tally, SHARE * left, worker)
        tallies[method.name, setting] = tally
        if tally.status == "timeout":
            stopped[method.name] = "the setting before timed out"
    _repeat(task, list(tallies.values()), end, worker, progress)
    ordered = [
        tallies[method.name, setting]
        for method in methods
        for setting in method.ladder
        if (method.name, setting) in tallies
    ]
    return ordered, _not_run(methods, tallies, stopped)


def _schedule(methods: Sequence[Method]) -> Iterator[tuple[Method, float]]:
    """Yield what to run: the ideal network, which is cheap, then the board; coarse to fine."""
    for problem in ("ideal", "board"):
        mine = [method for method in methods if method.problem == problem]
        for rung in range(max((len(method.ladder) for method in mine), default=0)):
            for method in mine:
                if rung < len(method.ladder):
                    yield method, method.ladder[rung]


def _attempt(task: Task, tally: Tally, allowed: float, worker: Worker) -> None:
    """Run a setting once and note what came of it."""
    method = tally.method
    try:
        if method.engine == "ngspice":  # a process of its own
            run = method.run(task, tally.setting, allowed)
        else:
            run = worker.call(allowed, method.run, task, tally.setting)
    except TimeoutError as error:
        if tally.run is None:
            tally.status, tally.note = "timeout", str(error)
            tally.seconds.append(allowed)
        return
    except FAILURES as error:
        tally.status, tally.note = "failed", f"{type(error).__name__}: {error}".splitlines()[0]
        return
    tally.run = tally.run or run
    tally.seconds.append(run.seconds)


def _repeat(
    task: Task,
    tallies: list[Tally],
    end: float,
    worker: Worker,
    progress: Callable[[str], None],
) -> None:
    for repeat in range(2, REPEATS + 1):
        for tally in sorted((t for t in tallies if t.run), key=lambda t: t.seconds[0]):
            left = end - clock.perf_counter()
            if HEADROOM * tally.seconds[0] < left:
                progress(f"{tally.method.name}, {tally.name}, run {repeat} of {REPEATS}")
                _attempt(task, tally, left, worker)


def _not_run(
    methods: Sequence[Method],
    tallies: dict[tuple[str, float], Tally],
    stopped: dict[str, str],
) -> list[str]:
    omissions = []
    for method in methods:
        left = [s for s in method.ladder if (method.name, s) not in tallies]
        if left:
            settings = ", ".join(f"{setting:g}" for setting in left)
            what = f"{method.name}, {method.setting} {settings}" if method.setting else method.name
            omissions.append(f"{what}: not run, {stopped[method.name]}")
    return omissions
