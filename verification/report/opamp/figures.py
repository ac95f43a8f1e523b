"""The figures of an op-amp in a terminal, until the command calls its view."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console

from taction.spice_models.opamp import OpAmp
from taction.verification.report.renderers.terminal import print_page
from taction.verification.report.views.opamp import Results, view
from taction.verification.report.views.opamp import figures_document as figures_document


def print_figures(
    opamp: OpAmp, notes: Mapping[str, str], results: Results, console: Console
) -> None:
    """Print the page of an op-amp."""
    print_page(view(opamp, notes, results), console)
