"""The result of a sweep, for programs: tables, grids and pictures of the stored points."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.system.errors import Complaint, InputError
from taction.verification.report.sweep.agreement import AgreementSummary, summarise
from taction.verification.report.sweep.files import dataset, frame
from taction.verification.report.sweep.records import records
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan
from taction.verification.studies.sweep.run import SweepCounts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taction.verification.report.blocks import Page


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SweepResult:
    """Every point of a sweep.

    Attributes
    ----------
    plan : Plan
        The grid: the axes, their values, the engines.
    store : Store
        A database in a file or in memory, open as long as the result exists.
    count : SweepCounts
        Numbers of all points, of the points computed now, and of each outcome.
    agreement : AgreementSummary or None
        How far two engines agree; None for a sweep by one engine.
    seconds : float
        Wall time, s.
    """

    plan: Plan
    store: Store
    count: SweepCounts
    agreement: AgreementSummary | None
    seconds: float = 0.0

    @classmethod
    def of(cls, plan: Plan, store: Store, count: SweepCounts, seconds: float = 0.0) -> SweepResult:
        """Return the result of a sweep that has ended."""
        several = len(plan.engines) > 1
        return cls(plan, store, count, summarise(plan, store) if several else None, seconds)

    @property
    def outcome(self) -> str:
        """``fail`` if the engines disagree, ``inconclusive`` if no point has a verdict."""
        if self._disagree:
            return "fail"
        outcomes = self.count.outcomes
        return "pass" if outcomes["pass"] + outcomes["fail"] else "inconclusive"

    def __repr__(self) -> str:
        plan, counts = self.plan, sorted(self.count.outcomes.items())
        outcomes = ", ".join(f"{number} {name}" for name, number in counts)
        if self._disagree:
            outcomes += f"; the engines disagree at {self._disagree}"
        names = " x ".join(axis.name for axis in plan.axes)
        return f"SweepResult({plan.scene.name!r}, {names}: {plan.total} points, {outcomes})"

    @property
    def _disagree(self) -> int:
        return 0 if self.agreement is None else self.agreement.disagree

    def _repr_html_(self) -> str:
        """Return the sweep as a card for a notebook."""
        from taction.verification.report.renderers.notebook import card

        return card(self._view(), "Sweep")

    def _view(self) -> Page:
        from taction.verification.report.views.sweep import view

        return view(self.plan, self.store, self.count)

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield every point as plain data in SI base units, in the order of the grid."""
        return records(self.plan, self.store)

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame``: a row for each point and engine, a column for each figure.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        _need("pandas")
        return frame(self.plan, self.store)

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset``: the axes and the engine are its coordinates.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        _need("xarray")
        return dataset(self.plan, self.store)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return maps over two axes, curves over one, or small maps over three.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            More than three axes, the picture cannot be written, or matplotlib is missing
            (``taction[plot]``).
        """
        from taction.verification.report.renderers.picture import draw_page
        from taction.verification.report.views.sweep import check_sweep_plot

        check_sweep_plot(self.plan, path)
        return draw_page(self._view(), path)

    def report(self, path: str | Path) -> None:
        """Write a report as one HTML file: outcomes, maps or curves, and the points.

        Raises
        ------
        InputError
            The name does not end in ``.html``, the file cannot be written, or a package of
            ``taction[report]`` is missing.
        """
        from taction.verification.report.renderers.page import write_page

        write_page(self._view(), str(path))


def _need(package: str) -> None:
    if importlib.util.find_spec(package) is None:
        text = f"needs {package}: pip install 'taction[data]'"
        raise InputError(f"to_{package}", Complaint("package", repr(package), text))
