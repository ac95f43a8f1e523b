"""One kill: start a study, send a signal at a random instant, run it again, and compare."""

from __future__ import annotations

import random
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.torture.studies import Place, Study
from tests.torture.victims import handles, processes, send, wait_for_end

LIMIT = 300.0  # s until a command that was disturbed has ended
ORPHAN_LIMIT = 15.0  # s until no process of the run is left
LOOK = 0.005  # s between two looks for a victim
BAD_WORDS = ("Traceback", "this is a bug", "Exception ignored")
KILLS: dict[str, tuple[tuple[str, ...], ...]] = {  # by victim: the signals, one after the other
    "parent": (("SIGINT",), ("SIGINT", "SIGINT"), ("SIGTERM",), ("SIGHUP",), ("SIGKILL",)),
    "worker": (("SIGKILL",), ("SIGTERM",)),
    "ngspice": (("SIGKILL",), ("SIGTERM",)),
    "tree": (("SIGKILL",),),
}


@dataclass(frozen=True)
class Kill:
    """What to do to which study: victim, signals, and the instant as a fraction of the run time."""

    study: Study
    victim: str
    signals: tuple[str, ...]
    instant: float

    @property
    def name(self) -> str:
        words = " twice" if len(self.signals) > 1 else ""
        return f"{self.signals[0]}{words}"


@dataclass
class Report:
    """What a disturbance did, and what was wrong afterwards."""

    study: str
    victim: str
    what: str
    status: int | None = None
    hit: bool = True  # whether the victim was alive
    orphans: list[str] = field(default_factory=list)
    left_by_kill: int = 0  # folders that the next run has to clear
    leftovers: list[str] = field(default_factory=list)
    equal: bool = True
    faults: list[str] = field(default_factory=list)
    said: str = ""  # the last line of the disturbed command on stderr


def plan_kills(studies: dict[str, Study], number: int, seed: int) -> list[Kill]:
    """`number` kills that take all victims and signals of all studies in turn, in random order."""
    chance = random.Random(seed)  # noqa: S311 - not a secret
    kinds = [
        (study, victim, signals)
        for study in studies.values()
        for victim, choices in KILLS.items()
        for signals in choices
        if study.pool or victim != "worker"
    ]
    chosen: list[tuple[Study, str, tuple[str, ...]]] = []
    while len(chosen) < number:
        chosen += chance.sample(kinds, len(kinds))
    return [Kill(*kind, instant=chance.random()) for kind in chosen[:number]]


def run_kill(kill: Kill, folder: Path, seconds: float, expected: Any) -> Report:
    """Disturb a run that takes `seconds`, run it again, and compare with the `expected` result."""
    report = Report(kill.study.name, kill.victim, kill.name)
    place = Place.make(folder)
    process = place.start(kill.study)
    started = time.monotonic()
    # The only ngspice of `verify` is there for a short time, towards the end.
    share = 0.5 * kill.instant if kill.victim == "ngspice" else kill.instant
    report.hit = _strike(kill, process, place.folder, started + share * seconds)
    end(report, process, place)
    again(report, kill.study, place, expected)
    return report


def _strike(kill: Kill, process: subprocess.Popen[str], folder: Path, instant: float) -> bool:
    """Wait for the instant, and from then on for the victim; return whether there was one.

    Until the command handles signals, Python itself answers SIGINT, with a traceback.
    """
    time.sleep(max(instant - time.monotonic(), 0.0))
    while process.poll() is None:
        if kill.signals[0] == "SIGINT" and not handles(process.pid, signal.SIGTERM):
            time.sleep(LOOK)
            continue
        found = processes(folder, process.pid)
        victims = found if kill.victim == "tree" else [p for p in found if p.kind == kill.victim]
        if victims:
            for number, name in enumerate(kill.signals):
                time.sleep(0.05 * number)
                for victim in victims if kill.victim == "tree" else victims[:1]:
                    send(victim, getattr(signal, name))
            return True
        time.sleep(LOOK)
    return False


def end(report: Report, process: subprocess.Popen[str], place: Place) -> None:
    """Wait for the end of a disturbed command and of all its processes."""
    try:
        report.status = process.wait(LIMIT)
    except subprocess.TimeoutExpired:
        report.faults.append(f"no end within {LIMIT:g} s")
        process.kill()
        process.wait()
    for orphan in wait_for_end(place.folder, process.pid, ORPHAN_LIMIT):
        report.orphans.append(orphan.kind)
        send(orphan, signal.SIGKILL)
    text = (place.folder / "stderr").read_text(errors="replace")
    report.said = text.strip().rpartition("\n")[2]
    report.faults += [f"{word}: {text[-300:]}" for word in BAD_WORDS if word in text]
    report.left_by_kill = sum(p.name.startswith("taction-run") for p in place.temporary.iterdir())


def again(report: Report, study: Study, place: Place, expected: Any) -> None:
    """Give the same command again, without a disturbance, and compare."""
    process = place.start(study)
    try:
        status = process.wait(LIMIT)
    except subprocess.TimeoutExpired:
        report.faults.append("the second run hangs")
        process.kill()
        process.wait()
        report.equal = False
        return
    report.orphans += [p.kind for p in wait_for_end(place.folder, process.pid, ORPHAN_LIMIT)]
    report.leftovers = place.leftovers()
    if status != 0:
        text = (place.folder / "stderr").read_text(errors="replace")
        report.faults.append(f"the second run ends with {status}: {text[-300:]}")
        report.equal = False
    else:
        report.equal = place.result(study) == expected
