"""A whole session of torture: undisturbed runs, kills, disasters, and the table of the results."""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tests.torture.commands import plan_commands, run_command
from tests.torture.disasters import DISASTERS, possible
from tests.torture.killing import Kill, Report, plan_kills, run_kill
from tests.torture.studies import Place, Study, all_studies

COLUMNS = ("victim", "what", "runs", "hit", "ends", "equal", "orphans", "left", "cleared", "faults")


@dataclass(frozen=True)
class Undisturbed:
    """An undisturbed run: wall time in s, and its result."""

    seconds: float
    result: Any


def undisturbed(study: Study, folder: Path) -> Undisturbed:
    """Run a study without a disturbance."""
    place = Place.make(folder)
    started = time.monotonic()
    status = place.start(study).wait(300.0)
    if status != 0:
        raise RuntimeError(f"{study.name} ends with {status}: {(folder / 'stderr').read_text()}")
    return Undisturbed(time.monotonic() - started, place.result(study))


def session(
    folder: Path,
    *,
    kills: int,
    disasters: int,
    commands: int,
    points: int,
    seed: int,
    jobs: int = 1,
    kinds: Sequence[str] = (),
) -> Iterator[Report]:
    """Yield the report of every disturbance, `jobs` at a time.

    `disasters` is the number of each kind of disaster (of `kinds`, or of all that are possible),
    `commands` that of commands on a bad machine.
    """
    studies = all_studies(points)
    planned = plan_kills(studies, kills, seed)
    storing = [study for study in studies.values() if study.stores]
    disturbed = {one.study.name for one in planned}
    disturbed |= {study.name for study in storing[:disasters]}
    normal = {name: undisturbed(studies[name], folder / f"normal-{name}") for name in disturbed}

    def kill(number: int, one: Kill) -> Report:
        run = normal[one.study.name]
        return run_kill(one, folder / f"kill-{number}", run.seconds, run.result)

    def destroy(name: str, number: int, study: Study) -> Report:
        run, place = normal[study.name], folder / f"{name.replace(' ', '-')}-{number}"
        chance = random.Random(f"{seed} {name} {number}")  # noqa: S311 - not a secret
        return DISASTERS[name](study, place, run.seconds, run.result, chance)

    def command(number: int, pair: tuple[str, str]) -> Report:
        return run_command(*pair, folder / f"command-{number}", f"{seed} command {number}")

    tasks = [partial(kill, *each) for each in enumerate(planned)]
    for name in kinds or possible():
        tasks += [partial(destroy, name, k, storing[k % len(storing)]) for k in range(disasters)]
    tasks += [partial(command, *each) for each in enumerate(plan_commands(commands, seed))]
    random.Random(seed).shuffle(tasks)  # noqa: S311 - a session that is stopped has some of each
    with ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(task) for task in tasks]
        try:
            for future in running:
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def is_fault(report: Report) -> bool:
    """Whether anything is wrong."""
    return bool(not report.equal or report.orphans or report.leftovers or report.faults)


def summary(report: Report) -> str:
    """A line of text about a disturbance."""
    text = f"{report.study} {report.victim} {report.what}: status {report.status} ({report.said})"
    if not is_fault(report):
        return text
    return f"{text} FAULT equal {report.equal} {report.orphans} {report.leftovers} {report.faults}"


def table(reports: list[Report]) -> str:
    """The reports by victim and signal, as a table in Markdown."""
    groups: dict[tuple[str, str], list[Report]] = {}
    for report in reports:
        groups.setdefault((report.victim, report.what), []).append(report)
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    for (victim, what), group in sorted(groups.items()):
        statuses = Counter(str(report.status) for report in group)
        ends = ", ".join(f"{status}: {number}" for status, number in sorted(statuses.items()))
        cells = [
            victim,
            what,
            len(group),
            sum(report.hit for report in group),
            ends,
            sum(report.equal for report in group),
            sum(len(report.orphans) for report in group),
            sum(report.left_by_kill for report in group),
            sum(report.left_by_kill for report in group if not report.leftovers),
            sum(len(report.faults) for report in group),
        ]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"
