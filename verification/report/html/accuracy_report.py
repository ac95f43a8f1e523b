"""The names of `taction.verification.report.views.accuracy` until the commands have moved."""

from __future__ import annotations

from taction.verification.report.views.accuracy import view

accuracy_report = view
