"""The names of `taction.verification.report.views.onset` until the commands have moved."""

from __future__ import annotations

from taction.verification.report.views.onset import view

onset_report = view
