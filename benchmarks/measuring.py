"""Timing in turns, and the figures that every section of the page returns.

A speed is a ratio to a named baseline that runs in the same rounds, so that other work of the
machine falls on both. A figure is the median of the rounds' own ratios, with their quartiles.
"""

from __future__ import annotations

import enum
import os
import random
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

ROOT = Path(__file__).parents[1]
SCENES = ROOT / "scenes"
Returned = TypeVar("Returned")


class Extent(enum.Enum):
    """How much a section measures: the least that shows it works, some minutes, or everything."""

    TINY = "tiny"
    QUICK = "quick"
    FULL = "full"


@dataclass(frozen=True)
class Figure:
    """A ratio to a baseline, beside the wanted value.

    Attributes
    ----------
    what, baseline : str
        What is compared with what.
    ratios : sequence of float
        One for each pair that was measured.
    wanted : float or None
        Limit of the measured value; None if there is none.
    value : float or None
        The measured value; by default the median of `ratios`.
    unit : str
        Unit of the measured value; empty for a ratio.
    least : bool
        Whether `wanted` is a lower limit.
    load : float
        Load average of the machine over the last minute.
    """

    what: str
    baseline: str
    ratios: Sequence[float]
    wanted: float | None = None
    value: float | None = None
    unit: str = ""
    least: bool = False
    load: float = field(default_factory=lambda: os.getloadavg()[0])

    @property
    def measured(self) -> float:
        """The value that is compared with `wanted`."""
        return statistics.median(self.ratios) if self.value is None else self.value

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """Lower quartile, median and upper quartile of the ratios."""
        if len(self.ratios) == 1:
            return self.ratios[0], self.ratios[0], self.ratios[0]
        low, median, high = statistics.quantiles(self.ratios, n=4, method="inclusive")
        return low, median, high

    @property
    def kept(self) -> bool:
        """Whether the measured value keeps the limit."""
        if self.wanted is None:
            return True
        return self.measured >= self.wanted if self.least else self.measured <= self.wanted


@dataclass(frozen=True)
class Table:
    """A table of details: a title, the columns, and rows of text."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Result:
    """What a section found.

    Attributes
    ----------
    figures : list of Figure
        Ratios, with what is wanted.
    tables : list of Table
        Details.
    plots : dict of str to callable
        For each file name a function that draws into a Matplotlib figure.
    """

    figures: list[Figure]
    tables: list[Table] = field(default_factory=list)
    plots: dict[str, Callable[..., None]] = field(default_factory=dict)


def in_turns(
    jobs: Mapping[str, Callable[[], Returned]], rounds: int, *, warm: bool = True
) -> dict[str, list[Returned]]:
    """Run `jobs` in rounds, each once a round in a random order; return what they return.

    If `warm`, each job runs once before, so that imports and caches cost nobody.
    """
    for job in jobs.values() if warm else ():
        job()
    found: dict[str, list[Returned]] = {name: [] for name in jobs}
    order, shuffle = list(jobs), random.Random(1993).shuffle  # noqa: S311 - no secret
    for _ in range(rounds):
        shuffle(order)
        for name in order:
            found[name].append(jobs[name]())
    return found


def ratios(job: Sequence[float], baseline: Sequence[float]) -> list[float]:
    """Return the ratios of the rounds."""
    return [a / b for a, b in zip(job, baseline, strict=True)]


def wall(job: Callable[[], object]) -> Callable[[], float]:
    """Return a function that runs `job` and returns its wall time, s."""

    def timed() -> float:
        begun = time.perf_counter()
        job()
        return time.perf_counter() - begun

    return timed


def children_seconds() -> float:
    """Return the processor time of all ended child processes, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@dataclass(frozen=True)
class Cost:
    """Cost of a process with its children: wall and processor time, s, and peak memory, MB."""

    wall: float
    processor: float
    memory: float


# A child's peak is read at its end: before its first instruction it shares its parent's memory.
PEAK = """
import atexit, resource, sys
def tell():
    lines = open("/proc/self/status").read().splitlines()
    own = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    print(max(own, children), file=sys.stderr)
atexit.register(tell)
"""
COMMAND = "from taction.__main__ import main\nmain(sys.argv[1:], prog_name='taction')"


def python(code: str, *words: str, accepted: tuple[int, ...] = (0,)) -> Cost:
    """Run Python in a process of its own and return the cost.

    Raises
    ------
    RuntimeError
        The process ended with a status that is not `accepted`; the message has its stderr.
    """
    before, begun = children_seconds(), time.perf_counter()
    command = [sys.executable, "-c", PEAK + code, *words]
    # A user's Python keeps its bytecode; without it a command compiles all its modules each time.
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    run = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begun
    if run.returncode not in accepted:
        raise RuntimeError(f"{' '.join(words)} ended with {run.returncode}: {run.stderr[-500:]}")
    memory = float(run.stderr.splitlines()[-1]) * 1024 / 1e6
    return Cost(seconds, children_seconds() - before, memory)


def taction(*words: str) -> Cost:
    """Run the command in a process of its own; a failed check is no error."""
    return python(COMMAND, *words, accepted=(0, 1, 3))


def machine() -> str:
    """Return versions, BLAS kernel and cores in a line, without names or paths of the machine."""
    import platform
    from importlib.metadata import version

    import scipy.linalg  # noqa: F401 - loads the BLAS
    from threadpoolctl import threadpool_info

    from taction.verification.engines.ngspice.executable import find_simulator

    simulator = find_simulator()
    blas = [each for each in threadpool_info() if each["user_api"] == "blas"]
    kernels = {f"{each.get('architecture', 'unnamed')}" for each in blas}
    threads = max(each["num_threads"] for each in blas)
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    return (
        f"Python {platform.python_version()}, {packages}, ngspice {simulator.version}"
        f"{' with KLU' if simulator.klu else ''}, BLAS kernel {' and '.join(sorted(kernels))}"
        f" on {threads} of {len(os.sched_getaffinity(0))} cores"
    )
