"""The picture of a tuning."""

from __future__ import annotations

from taction.verification.design.tune import Tuning
from taction.verification.report.renderers.picture import draw_sheet
from taction.verification.report.views.tune import sheet


def plot_tradeoff(tuning: Tuning, path: str) -> None:
    """Draw the picture of a tuning, see `taction.verification.report.views.tune`."""
    draw_sheet(sheet(tuning), path)
