"""The verdicts of several files as one table, with the reasons below, and as one document."""

from __future__ import annotations

from typing import Any

from taction.verification.studies.verify_files import VerifiedFiles


def files_document(files: VerifiedFiles) -> dict[str, Any]:
    """Return the verdicts of all files as plain data; each is the document of a single run."""
    return {
        "outcome": files.outcome,
        "exit_status": files.exit_status,
        "interrupted": files.interrupted,
        "counts": files.count(),
        "verdicts": list(files.documents),
    }
