"""Commands under conditions of a bad machine: each ends with its status and says why."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.support.paths import ROOT, SCENES
from tests.support.running import NO_BYTECODE
from tests.torture.killing import BAD_WORDS, LIMIT, ORPHAN_LIMIT, Report
from tests.torture.studies import MARK, SCENE
from tests.torture.victims import send, wait_for_end

COMMANDS: dict[str, tuple[str, ...]] = {
    "verify": ("verify", SCENE, "--engine", "statespace", "--json"),
    "verify with ngspice": ("verify", SCENE, "--engine", "ngspice", "--json"),
    "verify that fails": (
        *("verify", SCENE, "--engine", "statespace", "--json"),
        *("--set", "checks.settling_time.max=1ns", "--changes", "0"),
    ),
    "a scene that is missing": ("verify", "none.toml", "--json"),
    "netlist": ("netlist", SCENE),
    "netlist into a file": ("netlist", SCENE, "-o", "a.cir"),
    "bom": ("bom", SCENE),
    "solve": ("solve", SCENE, "--json"),
    "diff": ("diff", SCENE, SCENE),
    "sweep": ("sweep", SCENE, "--over", "C=50p,60p", "--engine", "statespace", "-o", "a.sqlite"),
    "montecarlo": ("montecarlo", SCENE, "-n", "3", "--engine", "statespace"),
    "new": ("new", "new.toml"),
    "an op-amp": ("parts", "show", "ua741"),
}
USUAL = {"verify that fails": 1, "a scene that is missing": 2}  # exit status; of the others 0


@dataclass(frozen=True)
class Condition:
    """What is wrong with the machine, and the statuses besides the `USUAL` one that are right."""

    line: str = 'exec "$0" "$@"'
    also: tuple[int, ...] = ()
    variables: dict[str, str] = field(default_factory=dict)
    damages: bool = False  # the scene
    folder: str = "work"  # where the command runs


def conditions(chance: random.Random) -> dict[str, Condition]:
    """Every condition by name, with sizes drawn by `chance`."""
    files, blocks = chance.randint(6, 40), chance.randint(8, 100)
    return {
        "nothing": Condition(),
        "stderr full": Condition('exec "$0" "$@" 2>/dev/full'),
        "stderr closed": Condition('exec "$0" "$@" 2>&-'),
        "stdin closed": Condition('exec "$0" "$@" <&-'),
        "stdout full": Condition('exec "$0" "$@" >/dev/full', (3,)),
        "stdout closed": Condition('exec "$0" "$@" >&-', (3,)),
        "a reader that ends": Condition('{ "$0" "$@"; echo $? >status; } | :', (141,)),
        "few open files": Condition(f'ulimit -n {files}; exec "$0" "$@"', (3,)),
        "short files": Condition(f'ulimit -f {blocks}; exec "$0" "$@"', (3,)),
        "no temporary folder": Condition(also=(3,), variables={"TMPDIR": "/nowhere"}),
        "no programs": Condition(also=(3,), variables={"PATH": "/nowhere"}),
        "ASCII": Condition(variables={"LC_ALL": "C", "PYTHONUTF8": "0"}),
        "an odd folder": Condition(folder="a\x1b[2J\n::error::b"),
        "a damaged scene": Condition(also=(0, 1, 2, 3), damages=True),
    }


def run_command(name: str, what: str, folder: Path, seed: str) -> Report:
    """Run a command under a condition."""
    chance = random.Random(seed)  # noqa: S311 - not a secret
    condition = conditions(chance)[what]
    report = Report(name, "command", what)
    work, temporary = folder / condition.folder, folder / "tmp"
    work.mkdir(parents=True)
    temporary.mkdir()
    scene = (SCENES / SCENE).read_bytes()
    (work / SCENE).write_bytes(damaged(scene, chance) if condition.damages else scene)
    own = {MARK: str(folder), "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)} | NO_BYTECODE
    shell = shutil.which("sh") or "/bin/sh"
    words = [shell, "-c", condition.line, sys.executable, "-m", "taction", *COMMANDS[name]]
    variables = os.environ | own | condition.variables
    with (folder / "stdout").open("wb") as out, (folder / "stderr").open("wb") as err:
        process = subprocess.Popen(words, cwd=work, env=variables, stdout=out, stderr=err)
    try:
        report.status = process.wait(LIMIT)
    except subprocess.TimeoutExpired:
        report.faults.append(f"no end within {LIMIT:g} s")
        process.kill()
        process.wait()
    if (work / "status").exists():  # of the command, whose shell waits for the reader
        report.status = int((work / "status").read_text())
    for orphan in wait_for_end(folder, process.pid, ORPHAN_LIMIT):
        report.orphans.append(orphan.kind)
        send(orphan, signal.SIGKILL)
    report.leftovers = [p.name for p in temporary.iterdir() if "-kept-" not in p.name]
    report.faults += wrong(report, condition, folder)
    return report


def wrong(report: Report, condition: Condition, folder: Path) -> Iterator[str]:
    """Yield what is wrong with the end of a command."""
    usual = USUAL.get(report.study, 0)
    said, told = ((folder / file).read_text(errors="replace") for file in ("stderr", "stdout"))
    report.said = said.strip().rpartition("\n")[2]
    yield from (f"{word}: {said[-300:]}" for word in BAD_WORDS if word in said)
    if report.status not in (usual, *condition.also):
        yield f"exit status {report.status}, usually {usual}: {said[-300:]}"
    if report.status in (2, 3) and not said.strip() and "stderr" not in report.what:
        yield f"exit status {report.status} without a word"
    if report.status == 1 and usual != 1:
        outcome = json.loads(told)["outcome"] if told.startswith("{") else "FAIL" in told
        if outcome not in ("fail", True):
            yield f"exit status 1, but no check failed: {told[-300:]}"


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Change up to three places of a file."""
    for _ in range(chance.randint(1, 3)):
        at = chance.randrange(len(content))
        new = chance.randbytes(chance.randint(0, 3)) if chance.random() < 0.5 else b"0"
        content = content[:at] + new + content[at + chance.randint(0, 3) :]
    return content


def plan_commands(number: int, seed: int) -> list[tuple[str, str]]:
    """`number` commands with conditions, each pair before any pair comes twice."""
    chance = random.Random(seed)  # noqa: S311 - not a secret
    pairs = [(name, what) for name in COMMANDS for what in conditions(chance)]
    chosen: list[tuple[str, str]] = []
    while len(chosen) < number:
        chosen += chance.sample(pairs, len(pairs))
    return chosen[:number]
