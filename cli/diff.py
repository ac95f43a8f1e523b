"""``taction diff``: keys and readings of two scenes."""

from __future__ import annotations

import sys
from typing import Any

import click

import taction
from taction.cli.common import ENGINE, command, console, print_json, stage_display
from taction.system.documents import plain


@command
@click.argument("first", metavar="A", type=click.Path())
@click.argument("second", metavar="B", type=click.Path())
@ENGINE
def diff(first: str, second: str, engine: str | None, as_json: bool) -> None:
    """Compare two boards: the keys that differ, then the readings of both verdicts.

    A and B are scenes, or files *.json that `taction verify SCENE --json` wrote. Exit status: 0 if
    all readings are equal within their uncertainties, 1 if one is not, 3 if that is unknown.
    """
    from taction.verification.report.difference.table import print_difference
    from taction.verification.studies.difference import compare_verdicts

    one, two = (_document(name, engine) for name in (first, second))
    difference = compare_verdicts(one, two, (first, second))
    if as_json:
        print_json(plain(difference))
    else:
        print_difference(difference, console())
    sys.exit(difference.exit_status)


def _document(name: str, engine: str | None) -> dict[str, Any]:
    from taction.verification.report.verdict.json_document import verdict_document
    from taction.verification.studies.difference import stored_verdict

    if name.lower().endswith(".json"):
        return stored_verdict(name)
    with stage_display() as progress:
        return verdict_document(taction.verify(name, engine=engine, progress=progress))
