"""CPU time of starting the command, and of `verify` beyond the simulation.

Run from the checkout: ``python benchmarks/startup.py [ROUNDS [SCENE]]``. A figure is the user and
system time of a fresh process from its first instruction to its end, without the processes it
starts: ngspice's are in a row of their own. The baseline is a Python that does nothing.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from timing import gathered, print_machine, print_rounds

SCENE = Path(__file__).parents[1] / "scenes" / "paper-breadboard.toml"

# The command, which at its end says what the processes that it waited for have used.
COMMAND = """
import atexit, resource, sys
def children():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(used.ru_utime + used.ru_stime, file=sys.stderr)
atexit.register(children)
from cli.main import main
main(sys.argv[1:], prog_name="taction")
"""


def cpu_time(*words: str) -> tuple[float, float]:
    """Run Python with ``-c`` and `words`; return its CPU time and its children's, s."""
    python = [sys.executable, "-c", *words]
    with subprocess.Popen(
        python, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as run:
        assert run.stderr is not None
        said = run.stderr.read()
        _, status, used = os.wait4(run.pid, 0)
        run.returncode = os.waitstatus_to_exitcode(status)
    assert run.returncode == 0, said
    children = float(said) if said else 0.0
    return used.ru_utime + used.ru_stime - children, children


def main(words: list[str]) -> None:
    """Measure and print."""
    rounds, scene = int(words[0]) if words else 20, words[1] if words[1:] else str(SCENE)
    print_machine()
    simulations: list[float] = []

    def verify() -> float:
        own, children = cpu_time(COMMAND, "verify", scene)
        simulations.append(children)
        return own

    verify()  # so that nothing is compiled to bytecode while the clock runs
    simulations.clear()
    jobs: dict[str, Callable[[], float]] = {
        "python": lambda: cpu_time("")[0],
        "taction --help": lambda: cpu_time(COMMAND, "--help")[0],
        "imports of verify": lambda: cpu_time("import cli.verify, verification.verify")[0],
        "taction verify, without ngspice": verify,
    }
    found = gathered(jobs, rounds)
    found["its ngspice processes"] = simulations
    print_rounds(f"CPU time, {rounds} rounds", found, "python")


if __name__ == "__main__":
    main(sys.argv[1:])
