"""A regression run as Markdown, for a merge request or the summary page of a CI job."""

from __future__ import annotations

from taction.verification.report.renderers.markdown import markdown
from taction.verification.report.views.regression import view
from taction.verification.studies.regression.run import RegressionReport


def regression_markdown(report: RegressionReport) -> str:
    """Return the page of a run as Markdown."""
    return markdown(view(report), "taction regress", level=2)
