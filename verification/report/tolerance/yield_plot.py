"""The picture of a yield."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taction.verification.report.renderers.picture import draw_sheet
from taction.verification.report.views.montecarlo import sheet
from taction.verification.studies.tolerance.varied_board import BoardSample
from taction.verification.studies.tolerance.yield_report import YieldReport

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_yield(
    name: str, report: YieldReport, samples: Sequence[BoardSample], path: str | Path | None = None
) -> Figure:
    """Draw the picture of a yield, see `taction.verification.report.views.montecarlo`."""
    return draw_sheet(sheet(name, report, samples), path)
