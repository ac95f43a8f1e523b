"""Verdicts as workflow commands of GitHub Actions, which shows them at the files of a change."""

from __future__ import annotations

from collections.abc import Iterator

from taction.verification.report.views.files import Document, reasons

_MESSAGE = {"%": "%25", "\r": "%0D", "\n": "%0A"}
_PROPERTY = _MESSAGE | {":": "%3A", ",": "%2C"}


def annotation_lines(document: Document) -> Iterator[str]:
    """Yield an error for each reason why a file does not pass, and a warning for each warning.

    Examples
    --------
    >>> bad = {"file": "a.toml", "outcome": "bad input", "error": {"message": "50%"}}
    >>> list(annotation_lines(bad))
    ['::error file=a.toml,title=taction verify (bad input)::50%25']
    """
    file = _escaped(document["file"], _PROPERTY)
    title = _escaped(f"taction verify ({document['outcome']})", _PROPERTY)
    for reason in reasons(document):
        yield f"::error file={file},title={title}::{_escaped(reason, _MESSAGE)}"
    for warning in document.get("warnings", ()):
        yield f"::warning file={file},title=taction verify::{_escaped(warning, _MESSAGE)}"


def _escaped(text: str, codes: dict[str, str]) -> str:
    return "".join(codes.get(character, character) for character in text)
