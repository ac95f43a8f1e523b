"""The names of `taction.verification.report.views.corners` until the commands have moved."""

from __future__ import annotations

from taction.verification.report.views.corners import view

corners_report = view
