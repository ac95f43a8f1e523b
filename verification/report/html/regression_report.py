"""The names of `taction.verification.report.views.regression` until the commands have moved."""

from __future__ import annotations

from taction.verification.report.views.regression import view

regression_report = view
