"""The command line of a run of ngspice, and its start."""

from __future__ import annotations

import functools
import shlex
import subprocess
from pathlib import Path

from taction.verification.engines.ngspice.executable import Simulator, environment
from taction.verification.engines.ngspice.parent_death import guard_of_process

STREAMS = ("stdout.txt", "stderr.txt")
_HERE = Path("$PWD")
_ARGUMENTS = ("-b", "-n", "-r", "out.raw", "deck.cir")


def command_line(simulator: Simulator) -> str:
    """Return a command line that repeats the run in its folder, also after the folder was moved."""
    return _quoted(simulator.executable, tuple(environment(_HERE).items()))


@functools.lru_cache(maxsize=4)
def _quoted(executable: str, variables: tuple[tuple[str, str], ...]) -> str:
    words = [f"{name}={value}" for name, value in variables if value != str(_HERE)]
    homes = " ".join(f'{name}="$PWD"' for name, value in variables if value == str(_HERE))
    return f"{shlex.join(['env', '-i', *words])} {homes} {shlex.join([executable, *_ARGUMENTS])}\n"


def launch(simulator: Simulator, folder: Path) -> subprocess.Popen[bytes]:
    """Start ngspice in `folder`, with its streams in files there."""
    with (
        open(f"{folder}/{STREAMS[0]}", "wb", buffering=0) as out,  # noqa: PTH123 - quicker
        open(f"{folder}/{STREAMS[1]}", "wb", buffering=0) as err,  # noqa: PTH123
    ):
        return subprocess.Popen(
            [*guard_of_process(), simulator.executable, *_ARGUMENTS],
            cwd=folder,
            env=environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,  # a new process group, which a timeout ends as a whole
        )
