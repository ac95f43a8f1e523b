"""The file of a baseline: JSON with a mark; a file that is none is refused without numpy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taction.system.documents import read
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded

FORMAT = 2
MARK = "taction_baseline"
MOVE_AWAY = "rename it, and `--update` writes a new baseline"
UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Commit:
    """A git commit and its date, as ``2026-11-27``; without git the revision is ``"unknown"``.

    Examples
    --------
    >>> Commit("0123456789abcdef", "2026-11-27").text, Commit().text
    ('commit 0123456789ab, 2026-11-27', '')
    """

    revision: str = UNKNOWN
    date: str = ""

    @property
    def text(self) -> str:
        """The first twelve digits and the date; empty where it is unknown."""
        known = self.revision != UNKNOWN
        return ", ".join(filter(None, (f"commit {self.revision[:12]}", self.date))) if known else ""


NO_COMMIT = Commit()


def commit_of(path: str | Path) -> Commit:
    """Return the commit at which a baseline was written; an unknown one of an older baseline.

    Raises
    ------
    InputError
        See `baseline_table`; or the head has another value than a commit.
    """
    data = baseline_table(path).get("commit", {})
    try:
        return read(Commit, data)
    except ValueError as error:
        reason = f"damaged: {error}; restore the file, or {MOVE_AWAY}"
        raise InputError(Path(path), Complaint("commit", "", reason)) from None


def baseline_table(path: str | Path) -> dict[str, Any]:
    """Return the content of a baseline.

    Raises
    ------
    InputError
        The file cannot be read, is damaged, is no baseline, or has another format.
    """
    path = Path(path)
    try:
        text = read_bounded(path, LARGEST)
    except UnusableFileError as error:
        reason = f"{error}; `--update` writes a baseline"
        raise InputError(path, Complaint("baseline", "", reason)) from None
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = f"damaged, no JSON: {error}; restore the file, or {MOVE_AWAY}"
        raise InputError(path, Complaint("baseline", "", reason)) from None
    if not isinstance(data, dict) or MARK not in data:
        reason = f"JSON, but no baseline of taction ('{MARK}' is missing); give another file"
        raise InputError(path, Complaint("baseline", "", reason))
    if data[MARK] != FORMAT:
        reason = f"another format; this taction reads {FORMAT}. Use the taction that wrote it, or "
        raise InputError(path, Complaint(MARK, repr(data[MARK]), reason + MOVE_AWAY))
    return data
