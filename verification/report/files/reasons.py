"""The names of `taction.verification.report.views.files` until the commands have moved."""

from taction.verification.report.views.files import margin_lines as margin_lines
