"""The names of `taction.verification.report.views.choose` until the commands have moved."""

from __future__ import annotations

from taction.verification.report.views.choose import view

choice_report = view
