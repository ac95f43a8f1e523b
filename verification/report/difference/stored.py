"""Read a verdict that ``taction verify --json`` stored."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded

PARTS = ("scene", "outcome", "checks", "channels", "step_amplitude", "stability")
ACCEPTED = "the document of one verdict, from `taction verify SCENE --json`"


def stored_verdict(path: str | Path) -> dict[str, Any]:
    """Return the document in a file.

    Raises
    ------
    InputError
        The file cannot be read, is not JSON, or does not hold the document of one verdict.
    """
    try:
        document = json.loads(read_bounded(path, LARGEST))
    except UnusableFileError as error:
        raise InputError(path, Complaint("file", "", f"{error}; expected {ACCEPTED}")) from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, Complaint("JSON", "", f"{error}; expected {ACCEPTED}")) from None
    if isinstance(document, dict) and "verdicts" in document:
        text = f"holds the verdicts of several scenes; expected {ACCEPTED}"
        raise InputError(path, Complaint("verdicts", "", text))
    missing = [name for name in PARTS if not isinstance(document, dict) or name not in document]
    if missing:
        text = f"lacks {', '.join(missing)}; expected {ACCEPTED}"
        raise InputError(path, Complaint("JSON", "", text))
    return dict(document)
