"""The picture of an onset."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from taction.verification.report.renderers.picture import draw_page
from taction.verification.report.views.onset import view
from taction.verification.studies.onset.onset import Onset

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_onset(onset: Onset, path: str | Path | None = None) -> Figure:
    """Draw the picture of an onset, see `taction.verification.report.views.onset`."""
    return draw_page(view(onset), path)
