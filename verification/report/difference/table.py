"""The difference of two verdicts in a terminal, until the command calls its view."""

from __future__ import annotations

from rich.console import Console

from taction.verification.report.renderers.terminal import print_page
from taction.verification.report.views.difference import view
from taction.verification.studies.difference import VerdictDifference


def print_difference(difference: VerdictDifference, console: Console) -> None:
    """Print the page of a difference."""
    print_page(view(difference), console)
