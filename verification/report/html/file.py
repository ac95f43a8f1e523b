"""The names of `taction.verification.report.renderers.page` until every caller has moved."""

from __future__ import annotations

from taction.verification.report.renderers.page import check_report_file as check_report_file
from taction.verification.report.renderers.page import page_html as report_html
from taction.verification.report.renderers.page import write_page as write_report

__all__ = ["check_report_file", "report_html", "write_report"]
