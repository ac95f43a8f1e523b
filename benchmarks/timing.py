"""Timing in interleaved rounds, and printing: what every benchmark here shares.

Speeds are given as ratios against a baseline that runs in the same rounds, so that whatever else
the machine does falls on both. A job's figures are the median and the range of its rounds; a ratio
is the median, with the quartiles, of the rounds' own ratios.
"""

from __future__ import annotations

import functools
import importlib.metadata
import os
import platform
import random
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

Rounds = dict[str, list[float]]
PACKAGES = ("numpy", "scipy", "PySpice", "pydantic", "rich")


def interleaved(jobs: Mapping[str, Callable[[], object]], rounds: int) -> Rounds:
    """Time `jobs` in rounds, each once a round in an order of its own; s of wall time.

    Parameters
    ----------
    jobs : mapping of str to callable
        What to time; each is called once before, untimed.
    rounds : int
        How many rounds.
    """
    for job in jobs.values():
        job()
    return gathered({name: functools.partial(wall_time, job) for name, job in jobs.items()}, rounds)


def wall_time(job: Callable[[], object]) -> float:
    """Return how long `job` takes, s."""
    start = time.perf_counter()
    job()
    return time.perf_counter() - start


def gathered(jobs: Mapping[str, Callable[[], float]], rounds: int) -> Rounds:
    """As `interleaved`, of jobs that return their own seconds and need no warming up."""
    found: Rounds = {name: [] for name in jobs}
    order, shuffle = list(jobs), random.Random(1993).shuffle  # noqa: S311 - no secret
    for _ in range(rounds):
        shuffle(order)
        for name in order:
            found[name].append(jobs[name]())
    return found


def milliseconds(seconds: Sequence[float]) -> tuple[str, str, str]:
    """Return median, least and greatest of `seconds`, as text in ms."""
    figures = statistics.median(seconds), min(seconds), max(seconds)
    median, least, greatest = (f"{1e3 * s:.4g}" for s in figures)
    return median, least, greatest


def ratio(job: Sequence[float], baseline: Sequence[float]) -> str:
    """Return the median of the rounds' ratios and their quartiles, as text."""
    ratios = [a / b for a, b in zip(job, baseline, strict=True)]
    low, middle, high = statistics.quantiles(ratios, n=4, method="inclusive")
    return f"{middle:.3f} ({low:.3f} to {high:.3f})"


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table whose first column is text and whose others are figures."""
    table = Table(title=title, title_justify="left")
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if place else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console(width=None if os.isatty(1) else 120).print(table)


def print_rounds(title: str, rounds: Rounds, baseline: str) -> None:
    """Print the figures of each job and its ratio to `baseline`."""
    columns = ("", "median, ms", "least", "greatest", f"ratio to {baseline}")
    base = rounds[baseline]
    rows = [
        (name, *milliseconds(seconds), ratio(seconds, base)) for name, seconds in rounds.items()
    ]
    print_table(title, columns, rows)


def print_machine() -> None:
    """Print one line on the machine, its load and the versions at work."""
    from spice_models.errors import SimulationError
    from verification.engines.ngspice.executable import find_simulator

    try:
        simulator = find_simulator()
        ngspice = f"ngspice {simulator.version}{' with KLU' if simulator.klu else ''}"
    except SimulationError:
        ngspice = "no ngspice"
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    load = "/".join(f"{part:.2f}" for part in os.getloadavg())
    print(f"{_processor()}, {len(os.sched_getaffinity(0))} cores, load {load}")
    print(f"Python {platform.python_version()}, {versions}, {ngspice}\n", flush=True)


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()
