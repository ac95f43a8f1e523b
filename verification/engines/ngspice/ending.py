"""The end of an ngspice process: exit status, signals, and the error stream.

The error stream names the failure where it can; a singular matrix, or a failed search for the
operating point, from which ngspice recovered is no failure but a doubt.
"""

from __future__ import annotations

import re
import signal
from dataclasses import dataclass
from pathlib import Path

from taction.system.errors import (
    BadEvidence,
    DidNotLoad,
    Killed,
    OutOfDisk,
    SimulationError,
    SimulatorNotFound,
    SingularCircuit,
    StepTooSmall,
    TimedOut,
)
from taction.system.foreign_files import MEGABYTE
from taction.verification.engines.ngspice.executable import REMEDY

LONGEST_STREAM = 100 * MEGABYTE  # of stdout or stderr; a run that writes more is ended
LONGEST_RESULT = 8000 * MEGABYTE  # of the raw file, likewise
LONGEST_LINE = 300  # characters of a line of the error stream in a message


@dataclass(frozen=True, slots=True)
class Ending:
    """How a process ended: exit status (negative: a signal), wall time in s, and error stream."""

    status: int
    timed_out: bool
    timeout: float
    seconds: float
    errors: str
    folder: Path
    flooded: str = ""  # the file that became longer than `longest` allows

    @property
    def raw(self) -> Path:
        """The result file."""
        return self.folder / "out.raw"


FAILURES: tuple[tuple[str, type[SimulationError], str], ...] = (
    # The first pattern that matches names the failure, so causes precede their consequences.
    (
        r"write error|no space left|adjusting rawfile",
        OutOfDisk,
        "the result could not be written. Free space where runs are kept (TMPDIR)",
    ),
    (
        r"(?s)singular matrix.*(operating point could not|initial timepoint)",
        SingularCircuit,
        "the circuit's matrix is singular: the circuit has a loop of voltage sources, or a node"
        " whose voltage no element determines",
    ),
    (
        r"time ?step too small",
        StepTooSmall,
        "the time step fell below the simulator's limit: the circuit has no solution there, or"
        " its tolerances are below rounding noise",
    ),
    (
        r"error on line|unable to find|unknown subckt|could not find|not parsed|no circuits? loaded"
        r"|circuits loaded|ignored|unusual leading|can't find|netlist line|set to 1|empty netlist",
        DidNotLoad,
        "ngspice did not read the deck as it is written",
    ),
    (r"error|fatal|aborted|interrupted|to low|too small", BadEvidence, "ngspice reported an error"),
)
_SIGNALS = {number.value: number.name for number in signal.Signals}
_SHELL = 128  # a shell adds this to the number of the signal that ended its program
_NOT_STARTED = (126, 127)  # of a shell, or of the program that guards ngspice
_DOUBT = re.compile(r"singular matrix|gmin stepping|source stepping|transient op", re.IGNORECASE)
# The option `noopiter` asks for these two.
_EXPECTED = ("Note: Starting dynamic gmin stepping", "Note: Dynamic gmin stepping completed")


def longest(file: str) -> int:
    """Return the most bytes that ngspice may write into a file of the run folder."""
    return LONGEST_RESULT if file == "out.raw" else LONGEST_STREAM


def check_end(ending: Ending) -> None:
    """Check point 1 for time and signals; the log explains other exit statuses."""
    if ending.flooded:
        most = longest(ending.flooded) / MEGABYTE
        raise BadEvidence(f"ngspice wrote over {most:g} MB into {ending.flooded} and was ended")
    if ending.timed_out:
        raise TimedOut(
            f"ngspice did not finish within {ending.timeout:g} s. Allow more time, a shorter record"
            " or a larger step"
        )
    if ending.status == -signal.SIGXFSZ:
        raise OutOfDisk("ngspice reached the limit on the size of a file (ulimit -f)")
    number = _signal_of(ending.status)
    if number:
        hint = " (is memory short?)" if number == signal.SIGKILL else ""
        name = _SIGNALS.get(number, str(number))
        raise Killed(f"signal {name} ended ngspice after {ending.seconds:.3g} s{hint}")
    if ending.status in _NOT_STARTED:
        raise SimulatorNotFound(f"ngspice did not start (exit status {ending.status}). {REMEDY}")


def _signal_of(status: int) -> int:
    """Return the number of the signal that ended a process, or the program of a shell; else 0."""
    number = -status if status < 0 else status - _SHELL
    return number if 0 < number < signal.NSIG else 0


def check_log(ending: Ending) -> None:
    """Check point 2, and the rest of point 1."""
    for pattern, failure, meaning in FAILURES:
        if re.search(pattern, ending.errors, re.IGNORECASE):
            raise failure(meaning)
    if ending.status != 0:
        raise BadEvidence(f"ngspice ended with exit status {ending.status} and gave no reason")


def important_lines(errors: str, limit: int = 12) -> str:
    """Return the lines of an error stream, notes last of all, each once and at most `limit`."""
    shortened = (line.rstrip()[:LONGEST_LINE] for line in errors.splitlines() if line.strip())
    lines = list(dict.fromkeys(shortened))
    important = [line for line in lines if not line.lower().startswith("note:")] or lines
    if len(important) > limit:
        half = limit // 2
        omitted = f"... {len(important) - limit} lines"
        important = [*important[:half], omitted, *important[-half:]]
    return "\n".join(important)


def doubts(errors: str) -> tuple[str, ...]:
    """Return the log's warnings that are not fatal, each once."""
    doubts = (line.strip() for line in errors.splitlines() if _DOUBT.search(line))
    return tuple(dict.fromkeys(line for line in doubts if not line.startswith(_EXPECTED)))
