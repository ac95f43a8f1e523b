"""An error as a document."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from taction.system.documents import OPTIONAL, Note
from taction.system.errors import Complaint, InputError, SimulationError, TactionError

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


def error_document(error: TactionError) -> ErrorDocument:
    """Return `error` with its outcome, ``bad input`` or ``inconclusive``, and all that it knows.

    Examples
    --------
    >>> from taction.system.errors import NoVerdictError
    >>> error_document(NoVerdictError("no engine")).outcome
    'inconclusive'
    """
    bad = error.exit_status == InputError.exit_status
    kind, text = type(error).__name__, str(error)
    failure = Failure(kind, text)
    if isinstance(error, InputError):
        failure = Failure(kind, text, str(error.file), tuple(error.complaints))
    if isinstance(error, SimulationError):
        folder = str(error.folder) if error.folder else None
        failure = Failure(kind, text, log=error.log, folder=folder)
    return ErrorDocument("bad input" if bad else "inconclusive", failure)


def plain_error(outcome: Ending, error: Exception, message: str) -> ErrorDocument:
    """Return the document of an error of any class."""
    return ErrorDocument(outcome, Failure(type(error).__name__, message))
