"""Every exception that taction raises on purpose; each says what it means and what helps.

`InputError` (exit status 2): the scene, a file or an option is wrong. `NoVerdictError` (3) and all
below it: the input is right, but there is no result to trust.

A failed check is not an exception; it is data (`taction.verification.verdict.checks`). Ctrl-C in a
study is `Interrupted`, a `KeyboardInterrupt` with what the study has finished.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taction.system.foreign_files import shortened, visible, visible_lines

LONGEST = {"key": 200, "value": 200, "accepted": 1500}  # characters of a complaint
MOST_LISTED = 20  # complaints in a message
INTERRUPTED = 130  # exit status of a process that Ctrl-C ended


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in a study: the text says what is kept, `result` holds what is finished, or None."""

    def __init__(self, text: str, result: Any = None) -> None:
        super().__init__(text)
        self.result = result


class TactionError(Exception):
    """Any error that taction raises on purpose; `exit_status` is that of the command line.

    Read the message: it names what is wrong and what is expected.

    Of a text over `LONGEST_MESSAGE` characters only the beginning and the end are kept.
    """

    exit_status = 3

    def __str__(self) -> str:
        return shortened(super().__str__())

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the finished text: the arguments of a subclass are not those of its base."""
        return type(self).__new__, (type(self), *self.args), dict(self.__dict__)


@dataclass(frozen=True, slots=True)
class Complaint:
    """One mistake in the input: its key, its value, and the values that are accepted.

    Of a text that is longer than `LONGEST` only the beginning and the end are kept.
    """

    key: str
    value: str
    accepted: str
    place: str = ""  # line and column in the file, the line itself, and a caret

    def __post_init__(self) -> None:
        for name, most in LONGEST.items():
            object.__setattr__(self, name, shortened(getattr(self, name), most))

    def __str__(self) -> str:
        value = f" = {self.value}" if self.value else ""
        below = "".join(f"\n  {line}" for line in self.place.splitlines())
        return f"{self.key}{value}: {self.accepted}{below}"


class InputError(TactionError):
    """The user's input cannot be used; `complaints` lists all mistakes that were found.

    Change the file, key or option that the message names to what it says is expected.
    """

    exit_status = 2

    def __init__(self, file: str | Path, *complaints: Complaint) -> None:
        self.file = str(file)
        self.complaints = complaints
        name = shortened(visible(self.file), LONGEST["key"])
        lines = [f"{name}: {visible_lines(str(one))}" for one in complaints[:MOST_LISTED]]
        if left := len(complaints) - len(lines):
            lines.append(f"{name}: and {left} more mistakes")
        super().__init__("\n".join(lines))


def listed(names: Iterable[object]) -> str:
    """Return names as a message has them: ``'ideal', 'ua741'``."""
    return ", ".join(map(repr, names))


def first_ones(texts: Sequence[str], most: int = 4, mark: str = ", ") -> str:
    """Return some texts, and how many there are besides: ``R1, R2 and 3 more``."""
    left = len(texts) - most
    return mark.join(texts[:most]) + (f" and {left} more" if left > 0 else "")


def nearest_question(word: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """Return ``did you mean 'ua741'? `` with the nearest known word; empty without a near one."""
    import difflib

    close = difflib.get_close_matches(word, list(known), n=1, cutoff=cutoff)
    return f"did you mean {close[0]!r}? " if close else ""


class NoVerdictError(TactionError):
    """The input is right, but no result can be trusted.

    Follow the message. Where it names no remedy, try the other engine (``--engine``).
    """


class SolverError(NoVerdictError):
    """A reference solution has no certificate: a larger lambda, or another scale of T, helps."""


class EngineError(NoVerdictError):
    """The state-space engine has no result: try ngspice, or change the part that is named."""


class DivergesError(EngineError):
    """A transient leaves every bound before its last instant: the board is unstable.

    `partial` is a `system.array_types.Waveforms` up to that instant, which this module must not
    import, or None.
    """

    def __init__(self, message: str, partial: object | None = None) -> None:
        super().__init__(message)
        self.partial = partial


class SimulationError(NoVerdictError):
    """An ngspice run failed.

    The kept folder repeats the run: ``sh command.txt``. ``--engine statespace`` needs no ngspice.

    Attributes
    ----------
    log : str
        The lines of the log that explain the failure.
    folder : Path or None
        The run folder, kept as a reproducer (deck, command line, log, partial result).
    partial : object or None
        A `system.array_types.Waveforms` of the points that were written before the failure,
        without any check (`object`, because this module must not import that class).
    """

    partial: object | None = None

    def __init__(self, message: str, *, log: str = "", folder: Path | None = None) -> None:
        super().__init__(message)
        self.log, self.folder = log, folder

    def __str__(self) -> str:
        parts = [super().__str__()]
        if self.log:
            parts += ["the log says:", *("  " + line for line in self.log.splitlines())]
        if self.folder is not None:
            again = "`sh command.txt` in this folder repeats the run"
            parts.append(f"reproducer: {self.folder} ({again})")
        return shortened("\n".join(parts))


def one_line(error: Exception) -> str:
    """Return the first line of an error, with the folder that a simulation kept for it."""
    line, folder = str(error).partition("\n")[0], getattr(error, "folder", None)
    return line if folder is None else f"{line} (reproducer: {folder})"


class SimulatorNotFound(SimulationError):  # noqa: N818
    """No ngspice executable: install one, name it in ``TACTION_NGSPICE``, or use statespace."""


class SimulatorTooOld(SimulationError):  # noqa: N818
    """An ngspice older than the oldest supported version, which the message names."""


class DidNotLoad(SimulationError):  # noqa: N818
    """The deck is refused: correct the card that the message quotes, or report a deck of ours."""


class SingularCircuit(SimulationError):  # noqa: N818
    """A voltage is not determined: connect the node that is named by a resistor or capacitor."""


class StepTooSmall(SimulationError):  # noqa: N818
    """The time step fell below the simulator's limit: another ``analysis.error`` may help."""


class OutOfDisk(SimulationError):  # noqa: N818
    """The result could not be written: make room, or set ``TMPDIR`` to a folder with room."""


class TimedOut(SimulationError):  # noqa: N818
    """The time limit ``analysis.timeout`` was reached; partial waveforms are in the run folder."""


class Killed(SimulationError):  # noqa: N818
    """A signal ended the simulator; if the system did for lack of memory, use statespace."""


class BadEvidence(SimulationError):  # noqa: N818
    """Exit status 0, but the result is incomplete or wrong: run again, report it if it returns."""


MACHINE_FAILURES = (SimulatorNotFound, SimulatorTooOld, OutOfDisk)
"""What is wrong with the machine, so that the next run there would fail, too."""
