"""An error as plain data, for JSON documents."""

from __future__ import annotations

from typing import Any

from taction.system.errors import InputError, SimulationError, TactionError


def error_document(error: TactionError) -> dict[str, Any]:
    """Return `error` with its outcome, ``bad input`` or ``inconclusive``, and all that it knows.

    Examples
    --------
    >>> from taction.system.errors import NoVerdictError
    >>> error_document(NoVerdictError("no engine"))["outcome"]
    'inconclusive'
    """
    document = plain_error(
        "bad input" if error.exit_status == InputError.exit_status else "inconclusive",
        error,
        str(error),
    )
    if isinstance(error, InputError):
        document["error"]["file"] = error.file
        document["error"]["complaints"] = [
            {"key": c.key, "value": c.value, "accepted": c.accepted} for c in error.complaints
        ]
    if isinstance(error, SimulationError):
        document["error"]["log"] = error.log
        document["error"]["folder"] = str(error.folder) if error.folder else None
    return document


def plain_error(outcome: str, error: Exception, message: str) -> dict[str, Any]:
    """Return the document of an error of any class."""
    return {"outcome": outcome, "error": {"kind": type(error).__name__, "message": message}}
