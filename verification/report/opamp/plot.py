"""The picture of an op-amp."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from taction.spice_models.opamp import OpAmp
from taction.verification.report.renderers.picture import draw_page
from taction.verification.report.views.opamp import Curves, view
from taction.verification.report.views.opamp import measure_curves as measure_curves

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_opamp(opamp: OpAmp, curves: dict[str, Curves], path: str | Path | None = None) -> Figure:
    """Draw the picture of an op-amp; `curves` by the name of the witness, ours first."""
    return draw_page(view(opamp, {}, {}, curves), path)
