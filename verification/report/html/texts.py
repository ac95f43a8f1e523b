"""The names of `taction.verification.report.texts` until every view has moved."""

from __future__ import annotations

from taction.verification.report.texts import LEAST_ERROR as LEAST_ERROR
from taction.verification.report.texts import LEAST_SHARE as LEAST_SHARE
from taction.verification.report.texts import NONE as NONE
from taction.verification.report.texts import counted as counted
from taction.verification.report.texts import figure as figure
from taction.verification.report.texts import number_cell as number_cell
from taction.verification.report.texts import opamp_name as opamp_name
from taction.verification.report.texts import outcome_cell as outcome_cell
from taction.verification.report.texts import percent as percent
from taction.verification.report.texts import quantity as quantity
from taction.verification.report.texts import readable as readable
from taction.verification.report.texts import text_cells as text_cells
from taction.verification.report.texts import titled as titled
from taction.verification.report.texts import with_error as with_error
