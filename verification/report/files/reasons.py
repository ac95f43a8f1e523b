"""What the document of a file says about its checks, for every kind of report."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from taction.verification.report.tables import spaced

Document = Mapping[str, Any]


def reasons(document: Document) -> Iterator[str]:
    """Yield why a file does not pass: its undecided and failed checks, or its error.

    Examples
    --------
    >>> check = {"name": "rise_time", "outcome": "fail", "reason": "3 us, above 2 us"}
    >>> list(reasons({"outcome": "fail", "checks": [check]}))
    ['rise time fails: 3 us, above 2 us']
    """
    if "error" in document:
        yield document["error"]["message"]
    ends = {"fail": "fails", "inconclusive": "is inconclusive"}
    for check in document.get("checks", ()):
        if check["outcome"] in ends:
            yield f"{spaced(check['name'])} {ends[check['outcome']]}: {check['reason']}"


def margin_lines(document: Document) -> Iterator[str]:
    """Yield the stability margins that were asked for."""
    for margin in document.get("stability", {}).get("margins", {}).values():
        doubt = f", but {margin['doubt']}" if margin["doubt"] else ""
        yield f"margin: {margin['text']}{doubt}"


def passed_text(document: Document) -> str:
    """Return how many checks pass; a dash where there is no verdict."""
    checks = document.get("checks")
    if not checks:
        return "-"
    return f"{sum(check['outcome'] == 'pass' for check in checks)} of {len(checks)} pass"


def largest(document: Document, name: str) -> float | None:
    """Return the largest `name` of the channels; None without one."""
    values = [channel[name] for channel in document.get("channels", ())]
    known = [value for value in values if value is not None and math.isfinite(value)]
    return max(known, default=None)
