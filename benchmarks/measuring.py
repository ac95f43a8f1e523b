"""Timing in turns, and the figures that every section of the page returns.

A speed is a ratio to a named baseline that runs in the same rounds, so that other work of the
machine falls on both. A figure is the median of the rounds' own ratios, with their quartiles.
"""

from __future__ import annotations

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
IMPORTS = "import of scipy.linalg and pydantic"
Returned = TypeVar("Returned")


@dataclass(frozen=True)
class Figure:
    """A ratio to a baseline, beside the wanted value."""

    what: str  # what is compared with what
    baseline: str
    ratios: Sequence[float]  # one for each pair that was measured
    wanted: float | None = None  # limit of the measured value; None if there is none
    value: float | None = None  # the measured value; by default the median of `ratios`
    unit: str = ""  # of the measured value; empty for a ratio
    least: bool = False  # whether `wanted` is a lower limit
    load: float = field(default_factory=lambda: os.getloadavg()[0])  # of the last minute

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


def processor_seconds() -> float:
    """Return the processor time of this process and of all ended child processes, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def processor(job: Callable[[], object]) -> Callable[[], float]:
    """Return a function that runs `job` and returns its processor time with children, s."""

    def timed() -> float:
        begun = processor_seconds()
        job()
        return processor_seconds() - begun

    return timed


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

    RuntimeError: it ended with a status that is not `accepted`; the message has its stderr.
    """
    before, begun = processor_seconds(), time.perf_counter()
    command = [sys.executable, "-c", PEAK + code, *words]
    # A user's Python keeps its bytecode; without it a command compiles all its modules each time.
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    run = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begun
    if run.returncode not in accepted:
        raise RuntimeError(f"{' '.join(words)} ended with {run.returncode}: {run.stderr[-500:]}")
    memory = float(run.stderr.splitlines()[-1]) * 1024 / 1e6
    return Cost(seconds, processor_seconds() - before, memory)


def imports() -> Cost:
    """Run a Python that imports what every verdict needs: the baseline of whole commands."""
    return python("import scipy.linalg, pydantic")


def taction(*words: str) -> Cost:
    """Run the command in a process of its own; a failed check and a refusal are no error."""
    return python(COMMAND, *words, accepted=(0, 1, 2, 3))


def in_seconds(
    what: str, found: Sequence[float], baseline: Sequence[float], wanted: float | None
) -> Figure:
    """Return the figure of times, s, over those of the imports."""
    return Figure(what, IMPORTS, ratios(found, baseline), wanted, statistics.median(found), "s")


def machine() -> str:
    """Return versions, BLAS kernel and cores in a line, without names or paths of the machine."""
    import platform
    from importlib.metadata import version

    import scipy.linalg  # noqa: F401 - loads the BLAS
    from threadpoolctl import threadpool_info

    from taction.verification.engines.ngspice.process import find_simulator

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
