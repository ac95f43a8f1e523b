"""An error as a document."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from taction.system.documents import OPTIONAL, Note
from taction.system.errors import Complaint, InputError, SimulationError

Ending = Literal["bad input", "inconclusive"]


@dataclass(frozen=True, slots=True)
class Failure:
    """Why there is no result."""

    kind: str
    message: str
    file: Annotated[str | None, OPTIONAL, Note("of bad input")] = None
    complaints: Annotated[tuple[Complaint, ...] | None, OPTIONAL] = None
    log: Annotated[str | None, OPTIONAL, Note("of a simulation")] = None
    folder: Annotated[str | None, OPTIONAL, Note("what reproduces the failed simulation")] = None


@dataclass(frozen=True, slots=True)
class ErrorDocument:
    """Any command that ended without its document."""

    outcome: Ending
    error: Failure


def error_document(error: Exception, message: str = "") -> ErrorDocument:
    """Return `error` with its outcome, ``bad input`` or ``inconclusive``, and all that it knows.

    Examples
    --------
    >>> from taction.system.errors import NoVerdictError
    >>> error_document(NoVerdictError("no engine")).outcome
    'inconclusive'
    """
    failure = Failure(type(error).__name__, message or str(error))
    if isinstance(error, InputError):
        failure = Failure(failure.kind, failure.message, str(error.file), tuple(error.complaints))
    if isinstance(error, SimulationError):
        folder = str(error.folder) if error.folder else None
        failure = Failure(failure.kind, failure.message, log=error.log, folder=folder)
    # As the error of a command line, of click, a mistake of the user has the exit status 2.
    ours = getattr(error, "exit_status", getattr(error, "exit_code", None)) == 2
    return ErrorDocument("bad input" if ours else "inconclusive", failure)
