"""The names of `taction.verification.report.views.tune` until the commands have moved."""

from __future__ import annotations

from taction.verification.report.views.tune import view

tuning_report = view
