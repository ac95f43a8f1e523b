"""Verify several scene files; a file without a verdict is a result, too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taction.system.documents import plain
from taction.system.error_document import error_document
from taction.system.errors import INTERRUPTED, NoVerdictError, TactionError
from taction.system.output_files import printable
from taction.system.results import Result
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.verdict.verify import Verdict, verify

NOT_RUN = "not run"
WORST_FIRST = (("bad input", 2), ("fail", 1), ("inconclusive", 3), ("pass", 0))

Describe = Callable[[Verdict], dict[str, Any]]


@dataclass(frozen=True, slots=True)
class VerifiedFiles(Result):
    """The documents of several files, each with its `file` and its `outcome`."""

    VIEW = "taction.verification.report.views.files:view"

    documents: tuple[dict[str, Any], ...]

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C came before the last verdict."""
        return any(document["outcome"] == NOT_RUN for document in self.documents)

    @property
    def outcome(self) -> str:
        """The worst outcome: bad input, fail, inconclusive, pass."""
        outcomes = {document["outcome"] for document in self.documents}
        return next((name for name, _ in WORST_FIRST if name in outcomes), NOT_RUN)

    @property
    def exit_status(self) -> int:
        """The first of 2, 1, 3 and 0 that a file has; 130 after Ctrl-C."""
        return INTERRUPTED if self.interrupted else dict(WORST_FIRST)[self.outcome]

    def count(self) -> dict[str, int]:
        """Return the number of files by outcome, without zeros."""
        outcomes = [document["outcome"] for document in self.documents]
        names = (*reversed([name for name, _ in WORST_FIRST]), NOT_RUN)
        return {name: outcomes.count(name) for name in names if name in outcomes}


def verify_file(path: Path, describe: Describe, engine: str | None = None) -> dict[str, Any]:
    """Verify one scene file and return the document of its verdict or of its error."""
    try:
        return describe(verify(read_scene(path, engine)))
    except TactionError as error:
        return _without_verdict(path, error)
    except MemoryError:
        return _without_verdict(path, NoVerdictError("out of memory: the scene is too large"))


def document_of(path: Path, found: dict[str, Any] | BaseException | None) -> dict[str, Any]:
    """Return what was found for a file, also if its process was killed or never began."""
    if found is None:
        return {"file": printable(str(path)), "outcome": NOT_RUN}
    if isinstance(found, BaseException):
        return _without_verdict(path, NoVerdictError(f"the process was killed: {found}"))
    return found


def _without_verdict(path: Path, error: TactionError) -> dict[str, Any]:
    return {"file": printable(str(path)), **plain(error_document(error))}
