"""The picture of a choice."""

from __future__ import annotations

from collections.abc import Sequence

from taction.verification.design.choose import Design
from taction.verification.report.renderers.picture import draw_sheet
from taction.verification.report.views.choose import sheet


def plot_choice(designs: Sequence[Design], best: Sequence[Design], title: str, path: str) -> None:
    """Draw the picture of a choice, see `taction.verification.report.views.choose`."""
    draw_sheet(sheet(title, designs, best), path)
