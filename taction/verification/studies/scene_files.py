"""The scene files that a command reads, and their verdicts; a file without one is a result, too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taction.system.documents import error_document, plain
from taction.system.errors import INTERRUPTED, Complaint, InputError, NoVerdictError, TactionError
from taction.system.output_files import printable
from taction.system.results import Result
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.verdict.verify import Verdict, verify


def find_scenes(folder: str | Path) -> tuple[Path, ...]:
    """Return the ``*.toml`` files of `folder`, by name; refuse a folder without any."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(folder, Complaint("DIR", "", "no such folder; expected one with scenes"))
    files = tuple(sorted(path for path in folder.glob("*.toml") if path.is_file()))
    if not files:
        raise InputError(folder, Complaint("DIR", "", "holds no scene; expected *.toml files"))
    return files


def scene_files(names: Sequence[str]) -> tuple[Path, ...]:
    """Return the files of `names`, in their order: files, and the ``*.toml`` files of folders.

    A file that is named twice is read once.
    """
    found: dict[Path, Path] = {}
    for name in names:
        for path in find_scenes(name) if Path(name).is_dir() else (Path(name),):
            found.setdefault(path.absolute(), path)
    return tuple(found.values())


NOT_RUN = "not run"
WORST_FIRST = (("bad input", 2), ("fail", 1), ("inconclusive", 3), ("pass", 0))

Describe = Callable[[Verdict], dict[str, Any]]


@dataclass(frozen=True, slots=True)
class VerifiedFiles(Result):
    """The documents of several files, each with its `file` and its `outcome`."""

    VIEW = "taction.verification.report.views.comparison_view:files_view"
    DOCUMENT = "taction.verification.report.documents.plain:VerifyFilesDocument"

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
    found = verdict_of(path, engine)
    return describe(found) if isinstance(found, Verdict) else without_verdict(found, "", path)


def verdict_of(path: Path, engine: str | None = None) -> Verdict | TactionError:
    """Return the verdict of a scene file, or why there is none."""
    try:
        return verify(read_scene(path, engine))
    except TactionError as error:
        return error
    except MemoryError:
        return NoVerdictError("out of memory: the scene is too large")


def without_verdict(
    error: BaseException | None, reason: str, path: Path, *_: object
) -> dict[str, Any]:
    """Return the document of a file without a verdict; `error` is None where it never began."""
    known = error if isinstance(error, TactionError) else NoVerdictError(reason)
    said = {"outcome": NOT_RUN} if error is None else plain(error_document(known))
    return {"file": printable(str(path)), **said}
