"""What is installed, and what each part is needed for."""

from __future__ import annotations

from taction.verification.report.blocks import EVERYWHERE, Notes, Page, Section
from taction.verification.studies.running.installation import Installation, InstalledPart


def view(result: Installation) -> Page:
    """Return the page of an installation."""
    lines = tuple(line for finding in result.findings for line in _lines(finding))
    missing = sum(not finding.ok for finding in result.findings)
    return Page(
        title="installation",
        command="taction self doctor",
        summary=f"missing: {missing}" if missing else "nothing is missing",
        sections=(Section("Parts", (Notes("", lines),), media=EVERYWHERE),),
    )


def _lines(finding: InstalledPart) -> tuple[str, str]:
    mark = "ok     " if finding.ok else "missing"
    return f"{mark}  {finding.what}: {finding.found}", f"         {finding.means}"
