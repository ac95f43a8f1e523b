"""The picture of a work-precision study."""

from __future__ import annotations

from taction.verification.report.renderers.picture import draw_page
from taction.verification.report.views.accuracy import view
from taction.verification.studies.work_precision.study import WorkPrecisionStudy


def plot_study(study: WorkPrecisionStudy, path: str) -> None:
    """Draw the picture of a study, see `taction.verification.report.views.accuracy`."""
    draw_page(view(study), path)
