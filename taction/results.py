"""What `taction.onset` and `taction.montecarlo` return: results with their pictures.

The pictures are reports, and the studies that make the results must not import reports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

from taction.verification.studies.onset import onset
from taction.verification.studies.tolerance import yield_report
from taction.verification.studies.tolerance.varied_board import BoardSample

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Onset(onset.Onset):
    """The results of `taction.onset`: every crossing of a scene over one axis."""

    __slots__ = ()

    @classmethod
    def of(cls, found: onset.Onset) -> Onset:
        """Return `found` with its picture."""
        return cls(*(getattr(found, each.name) for each in fields(found)))

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the picture of ``onset --plot``: the pole map and the root locus.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            The picture cannot be written, or matplotlib is missing (``taction[plot]``).
        """
        from taction.verification.report.onset.plot import plot_onset

        return plot_onset(self, path)


@dataclass(frozen=True, slots=True, repr=False)
class YieldReport(yield_report.YieldReport):
    """The results of `taction.montecarlo`: the yield, its interval, and what is behind it.

    Attributes
    ----------
    name : str
        Of the scene.
    boards : tuple of BoardSample
        The samples, in the order of their numbers.
    """

    name: str = "scene"
    boards: tuple[BoardSample, ...] = field(default=(), compare=False)

    @classmethod
    def of(
        cls, report: yield_report.YieldReport, name: str, boards: Sequence[BoardSample]
    ) -> YieldReport:
        """Return `report` of the samples `boards` of the scene `name`."""
        values = {each.name: getattr(report, each.name) for each in fields(report)}
        return cls(**values, name=name, boards=tuple(boards))

    def _repr_html_(self) -> str:
        """Return the yield as a card for a notebook."""
        from taction.verification.report.cards import yield_card

        return yield_card(self.name, self).html()

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the picture of ``montecarlo --plot``: histograms with limits, and culprits.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            The picture cannot be written, or matplotlib is missing (``taction[plot]``).
        """
        from taction.verification.report.tolerance.yield_plot import plot_yield

        return plot_yield(self.name, self, self.boards, path)
