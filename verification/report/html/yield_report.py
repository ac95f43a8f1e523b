"""The names of `taction.verification.report.views.montecarlo` until the commands have moved."""

from __future__ import annotations

from taction.verification.report.views.montecarlo import view

yield_report = view
