"""The names of `taction.verification.report.blocks` until every view has moved."""

from __future__ import annotations

from taction.verification.report.blocks import Bar as Bar
from taction.verification.report.blocks import Bars as Bars
from taction.verification.report.blocks import Block as Block
from taction.verification.report.blocks import Cell as Cell
from taction.verification.report.blocks import Code as Code
from taction.verification.report.blocks import Drawing as Drawing
from taction.verification.report.blocks import Facts as Facts
from taction.verification.report.blocks import Notes as Notes
from taction.verification.report.blocks import Page as Report
from taction.verification.report.blocks import Picture as Picture
from taction.verification.report.blocks import PictureView as View
from taction.verification.report.blocks import Range as Range
from taction.verification.report.blocks import Ranges as Ranges
from taction.verification.report.blocks import Section as Section
from taction.verification.report.blocks import Table as Table
from taction.verification.report.charts import Outcome as Outcome

__all__ = ["Bar", "Bars", "Block", "Cell", "Code", "Drawing", "Facts", "Notes", "Outcome"]
__all__ += ["Picture", "Range", "Ranges", "Report", "Section", "Table", "View"]
