"""Kills, disasters, and commands on a bad machine: nothing is lost, and nothing stays.

With every commit a few; `make torture` runs every kind `TACTION_TORTURE` times, at instants and
with sizes that are drawn anew where `TACTION_SEED` is another.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from tests.support import clusters
from tests.support.paths import ROOT, SCENES
from tests.support.running import NO_BYTECODE
from tests.torture.studies import MARK, SCENE, STORING, STUDIES, Place, ended, processes

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc"),
    pytest.mark.usefixtures("ngspice"),
]
ROUNDS, SEED = (int(os.environ.get(f"TACTION_{name}", "0")) for name in ("TORTURE", "SEED"))
SECTOR = 512  # bytes, which a disk writes whole or not at all
KILLS = {  # by victim: the signals, one after the other
    "parent": (("SIGINT",), ("SIGINT", "SIGINT"), ("SIGTERM",), ("SIGHUP",), ("SIGKILL",)),
    "worker": (("SIGKILL",), ("SIGTERM",)),
    "ngspice": (("SIGKILL",), ("SIGTERM",)),
    "tree": (("SIGKILL",),),
}
EVERY_KILL = [
    (study, victim, signals)
    for study, (victim, choices) in product(STUDIES, KILLS.items())
    for signals in choices
    if study in STORING or victim != "worker"
]
Undisturbed = Callable[[str], tuple[float, Any]]


def some(every: list[tuple[Any, ...]], few: list[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
    """Return what is tested, each with a generator of random numbers of its own."""
    rounds = [(*each, k) for k in range(ROUNDS) for each in every] or [(*each, 0) for each in few]
    return [(*each, random.Random(f"{SEED} {each} {k}")) for *each, k in rounds]  # noqa: S311


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    """Wall time, s, and result of a study that nobody disturbs."""
    known: dict[str, tuple[float, Any]] = {}

    def run(study: str) -> tuple[float, Any]:
        if study not in known:
            place, began = Place.make(tmp_path_factory.mktemp("usual") / "run", study), time.time()
            process = place.start()
            assert list(ended(process, place.folder)) == []
            assert process.returncode == 0, place.said
            known[study] = time.time() - began, place.result()
        return known[study]

    return run


def handles(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal."""
    text = Path(f"/proc/{pid}/status").read_text()
    return bool(int(text.partition("SigCgt:")[2].split()[0], 16) >> (number - 1) & 1)


def strike(
    process: subprocess.Popen[Any], folder: Path, victim: str, signals: tuple[str, ...], wait: float
) -> bool:
    """Wait, and from then on for the victim; return whether there was one.

    Until the command handles signals, Python itself answers SIGINT, with a traceback.
    """
    time.sleep(wait)
    while process.poll() is None:
        found = list(processes(folder, process.pid))
        kind = "ngspice" if victim == "tree" else victim  # of a tree all, while ngspice runs
        victims = [each for each in found if each.kind == kind][:1]
        victims = found if victims and victim == "tree" else victims
        if victims and (signals[0] != "SIGINT" or handles(process.pid, signal.SIGTERM)):
            for number, name in enumerate(signals):
                time.sleep(0.05 * number)
                for each in victims:
                    each.send(getattr(signal, name))
            return True
        time.sleep(0.005)
    return False


@pytest.mark.parametrize(
    ("study", "victim", "signals", "chance"),
    some(EVERY_KILL, [("sweep", "tree", ("SIGKILL",)), ("montecarlo", "worker", ("SIGTERM",))]),
)
def test_a_kill_loses_nothing(
    study: str, victim: str, signals: tuple[str, ...], chance: random.Random,
    undisturbed: Undisturbed, tmp_path: Path,
) -> None:  # fmt: skip
    seconds, expected = undisturbed(study)
    wait = chance.random() * seconds
    for number in range(5):  # a command may have ended before its instant
        place = Place.make(tmp_path / f"{number}", study)
        process = place.start()
        hit = strike(process, place.folder, victim, signals, wait)
        assert list(ended(process, place.folder)) == []
        assert list(place.again(expected)) == []
        if hit:
            break
        wait *= 0.5
    assert hit


Disaster = Callable[[Place, float, random.Random], Iterator[str]]


def power_cut(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Copy database and log at one instant of a run, lose the end of the log, or sectors of it.

    The command is stopped while the two files are copied. The log is not synchronised after every
    point.
    """
    running = Place.make(place.folder / "running", place.study)
    process = running.start()
    while not running.database.exists() and process.poll() is None:
        time.sleep(0.005)
    time.sleep(chance.random() * seconds)
    os.kill(process.pid, signal.SIGSTOP)
    log = place.work / f"{place.database.name}-wal"
    for name in (place.database.name, log.name):
        if (running.work / name).exists():
            shutil.copy(running.work / name, place.work / name)
    os.kill(process.pid, signal.SIGKILL)
    yield from ended(process, running.folder)
    if log.exists():
        kept = chance.randint(0, log.stat().st_size)
        if chance.random() < 0.5:
            os.truncate(log, kept)
        else:
            with log.open("r+b") as stream:
                stream.seek(kept // SECTOR * SECTOR)
                stream.write(bytes(SECTOR * chance.randint(1, 20)))


def two_at_once(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Start the same command twice on one database."""
    first = place.start()
    time.sleep(0.5 * chance.random() * seconds)
    second = place.start()
    second.wait()
    yield from ended(first, place.folder)


def full_disk(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Let no file grow beyond a random size."""
    yield from without_verdicts(place, largest_file=chance.randint(1_000, 120_000))


def full_memory_disk(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Let /dev/shm, which holds the temporary files, have a few kB.

    In a changed root, "/" is no mount, so /dev/shm alone is kept from the rest of the machine.
    """
    alone = "{ mount --make-rprivate / || mount --make-private /dev/shm; } 2>/dev/null"
    size = f"size={chance.randint(4, 300)}k"
    script = f"{alone} && mount -t tmpfs -o {size} tmpfs /dev/shm && export TMPDIR=/dev/shm"
    rights = [] if os.geteuid() == 0 else ["-r"]
    own = ["unshare", *rights, "--mount", "--propagation", "unchanged", "sh", "-c"]
    if shutil.which("mount") is None or subprocess.run([*own, script], check=False).returncode:
        pytest.skip("a memory disk needs `mount` and the right to use it")
    yield from without_verdicts(place, before=[*own, f'{script} && exec "$0" "$@"'])


def removed_simulator(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Remove ngspice in the middle of a run."""
    link = place.folder / "ngspice"
    link.symlink_to(shutil.which(os.environ.get("TACTION_NGSPICE") or "ngspice") or "ngspice")

    def remove() -> None:
        time.sleep(chance.random() * seconds)
        link.unlink()

    yield from without_verdicts(place, then=remove, TACTION_NGSPICE=str(link))


def without_verdicts(
    place: Place, then: Callable[[], None] = lambda: None, **disturbed: Any
) -> Iterator[str]:
    """Run a disturbed study: no failure of the machine is stored as the result of a point."""
    process = place.start(**disturbed)
    then()
    yield from ended(process, place.folder)
    if process.returncode not in (0, 3):
        yield f"exit status {process.returncode}: {place.said[-300:]}"
    yield from (f"stored: {row}" for row in place.rows().values() if row[0] == "error")


def other_version(place: Place, seconds: float, chance: random.Random) -> Iterator[str]:
    """Run on a Dask cluster whose only worker has another taction, or one that lacks a module."""
    version, ours = f"0.{chance.randint(2, 9)}.{chance.randint(0, 9)}", metadata.version("taction")
    without = chance.choice((None, "verification/studies/sweep/plan.py", "system/errors.py"))
    with ExitStack() as stack:
        (place.folder / "cluster").mkdir()
        file = stack.enter_context(clusters.scheduler(place.folder / "cluster"))
        other = clusters.another_taction(place.folder / "other", version, without)
        clusters.worker(stack, file, source=other)
        process = place.start("--cluster", clusters.address(file))
        yield from ended(process, place.folder)
    known = version in place.said or without is not None  # else no function of ours answers there
    if process.returncode != 3 or not known or ours not in place.said:
        yield f"exit status {process.returncode}, without {without}: {place.said[-300:]}"
    yield from (f"stored: {row}" for row in place.rows().values())


DISASTERS = (
    power_cut, two_at_once, full_disk, full_memory_disk, removed_simulator, other_version
)  # fmt: skip


@pytest.mark.parametrize(
    ("disaster", "study", "chance"),
    some(list(product(DISASTERS, STORING)), [(power_cut, "sweep"), (two_at_once, "montecarlo")]),
)
def test_a_disaster_loses_nothing(
    disaster: Disaster, study: str, chance: random.Random, undisturbed: Undisturbed, tmp_path: Path
) -> None:
    seconds, expected = undisturbed(study)
    place = Place.make(tmp_path / "run", study)
    assert list(disaster(place, seconds, chance)) == []
    assert list(place.again(expected)) == []


USUAL = {  # the exit status of each command where nothing is wrong
    ("verify", SCENE, "--engine", "statespace", "--json"): 0,
    ("verify", SCENE, "--engine", "ngspice", "--json"): 0,
    ("verify", SCENE, "--engine", "statespace", "--json", "--set",
     "checks.settling_time.max=1ns", "--changes", "0"): 1,
    ("verify", "none.toml", "--json"): 2,
    ("netlist", SCENE): 0,
    ("netlist", SCENE, "-o", "a.cir"): 0,
    ("diff", SCENE, SCENE): 0,
    ("sweep", SCENE, "--over", "C=50p,60p", "--engine", "statespace", "-o", "a.sqlite"): 0,
    ("montecarlo", SCENE, "-n", "3", "--engine", "statespace"): 0,
    ("new", "new.toml"): 0,
    ("parts", "show", "ua741"): 0,
}  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """What is wrong with the machine, and the statuses besides the `USUAL` one that are right.

    A `{}` in the line stands for a size that is drawn from `sizes`.
    """

    line: str = 'exec "$0" "$@"'
    also: tuple[int, ...] = ()
    sizes: tuple[int, int] = (0, 0)
    variables: dict[str, str] = field(default_factory=dict)
    folder: str = "work"  # where the command runs


CONDITIONS = {
    "stderr full": Condition('exec "$0" "$@" 2>/dev/full'),
    "stderr closed": Condition('exec "$0" "$@" 2>&-'),
    "stdin closed": Condition('exec "$0" "$@" <&-'),
    "stdout full": Condition('exec "$0" "$@" >/dev/full', (3,)),
    "stdout closed": Condition('exec "$0" "$@" >&-', (3,)),
    "a reader that ends": Condition('{{ "$0" "$@"; echo $? >status; }} | :', (141,)),
    "few open files": Condition('ulimit -n {}; exec "$0" "$@"', (3,), (6, 40)),
    "short files": Condition('ulimit -f {}; exec "$0" "$@"', (3,), (8, 100)),
    "no temporary folder": Condition(also=(3,), variables={"TMPDIR": "/nowhere"}),
    "no programs": Condition(also=(3,), variables={"PATH": "/nowhere"}),
    "ASCII": Condition(variables={"LC_ALL": "C", "PYTHONUTF8": "0"}),
    "an odd folder": Condition(folder="a\x1b[2J\n::error::b"),
    "a damaged scene": Condition(also=(0, 1, 2, 3)),
}
VERIFY, *_, SWEEP, _, NEW, _ = USUAL


@pytest.mark.parametrize(
    ("words", "what", "chance"),
    some(
        list(product(USUAL, CONDITIONS)),
        [(VERIFY, "few open files"), (SWEEP, "no temporary folder"), (NEW, "stdout closed"),
         (VERIFY, "a damaged scene")],
    ),
)  # fmt: skip
def test_a_command_on_a_bad_machine_says_why_it_ends(
    words: tuple[str, ...], what: str, chance: random.Random, tmp_path: Path
) -> None:
    condition, work, usual = CONDITIONS[what], tmp_path / CONDITIONS[what].folder, USUAL[words]
    work.mkdir()
    (tmp_path / "tmp").mkdir()
    scene = (SCENES / SCENE).read_bytes()
    for _ in range(chance.randint(1, 3) if what == "a damaged scene" else 0):
        at, new = chance.randrange(len(scene)), chance.randbytes(chance.randint(0, 3))
        scene = scene[:at] + new + scene[at + chance.randint(0, 3) :]
    (work / SCENE).write_bytes(scene)
    own = {MARK: str(tmp_path), "TMPDIR": str(tmp_path / "tmp"), "PYTHONPATH": str(ROOT)}
    line = condition.line.format(chance.randint(*condition.sizes))
    with (tmp_path / "stdout").open("wb") as out, (tmp_path / "stderr").open("wb") as err:
        process = subprocess.Popen(
            [shutil.which("sh") or "/bin/sh", "-c", line, sys.executable, "-m", "taction", *words],
            cwd=work, stdout=out, stderr=err,
            env=os.environ | own | NO_BYTECODE | condition.variables,
        )  # fmt: skip
    assert list(ended(process, tmp_path)) == []
    status, told = process.returncode, (tmp_path / "stdout").read_text(errors="replace")
    if (work / "status").exists():  # of the command, whose shell waits for the reader
        status = int((work / "status").read_text())
    said = (tmp_path / "stderr").read_text(errors="replace")
    assert status in (usual, *condition.also), said
    assert said.strip() or status not in (2, 3) or "stderr" in what
    if status == 1 and usual != 1:  # a damaged scene
        assert json.loads(told)["outcome"] == "fail" if told.startswith("{") else "FAIL" in told
    assert [each.name for each in (tmp_path / "tmp").iterdir() if "-kept-" not in each.name] == []
