"""Every exception that taction raises on purpose.

::

    TactionError                     exit status
    ├── InputError                   2   the scene, a file or an option is wrong
    └── NoVerdictError               3   nothing wrong was asked, yet no answer can be given
        ├── SolverError                  a reference solution did not earn its certificate
        ├── EngineError                  the state-space engine cannot answer
        └── SimulationError              an ngspice run did not yield evidence
            ├── SimulatorNotFound
            ├── SimulatorTooOld
            ├── DidNotLoad
            ├── SingularCircuit
            ├── StepTooSmall
            ├── OutOfDisk
            ├── TimedOut
            ├── Killed
            └── BadEvidence              exit 0, but the result is not what was asked for

A failed check is not an exception; it is data (`verification.pipeline.checks`). The tree stands on
the lowest floor because every floor raises from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


class TactionError(Exception):
    """Root of the tree; `exit_status` is what the command line ends with."""

    exit_status = 3


@dataclass(frozen=True, slots=True)
class Complaint:
    """One mistake in the input: where it stands, what was found, what would be accepted."""

    key: str
    value: str
    accepted: str

    def __str__(self) -> str:
        found = f" = {self.value}" if self.value else ""
        return f"{self.key}{found}: {self.accepted}"


class InputError(TactionError):
    """The user's input cannot be used; holds every complaint that was found at once."""

    exit_status = 2

    def __init__(self, file: str | Path, *complaints: Complaint) -> None:
        self.file = str(file)
        self.complaints = complaints
        super().__init__("\n".join(f"{self.file}: {c}" for c in complaints))


class NoVerdictError(TactionError):
    """The question was right, but no trustworthy answer can be given."""


class SolverError(NoVerdictError):
    """A reference solution did not reach its certificate."""


class EngineError(NoVerdictError):
    """The state-space engine cannot answer for this circuit."""


class SimulationError(NoVerdictError):
    """An ngspice run failed.

    Attributes
    ----------
    log : str
        The log's telling lines.
    folder : Path or None
        The run folder, kept as a reproducer (deck, command line, log, partial result).
    partial : object or None
        A `verification.waveforms.Waveforms` of the points that reached the disk before the
        failure, without any check; None where there are none. (`object`, since this file stands
        below that one.)
    """

    partial: object | None = None

    def __init__(self, message: str, *, log: str = "", folder: Path | None = None) -> None:
        self.log = log
        self.folder = folder
        parts = [message]
        if log:
            parts.append("the log says:\n" + "\n".join("  " + line for line in log.splitlines()))
        if folder is not None:
            parts.append(f"reproducer: {folder}")
        super().__init__("\n".join(parts))


class SimulatorNotFound(SimulationError):  # noqa: N818
    """No ngspice executable."""


class SimulatorTooOld(SimulationError):  # noqa: N818
    """An ngspice below the oldest supported version."""


class DidNotLoad(SimulationError):  # noqa: N818
    """The deck was refused."""


class SingularCircuit(SimulationError):  # noqa: N818
    """A singular matrix."""


class StepTooSmall(SimulationError):  # noqa: N818
    """The time step fell below the simulator's limit."""


class OutOfDisk(SimulationError):  # noqa: N818
    """The result could not be written."""


class TimedOut(SimulationError):  # noqa: N818
    """The time allowed was used up; partial waveforms are in the run folder."""


class Killed(SimulationError):  # noqa: N818
    """A signal ended the simulator."""


class BadEvidence(SimulationError):  # noqa: N818
    """The run ended well, but its result is not what was asked for."""
