"""`taction.Verdict`: the verdict of `taction.verification.verdict.verify` with its table as text.

The table is a report, and the pipeline that makes verdicts must not import reports.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from taction.board import Circuit
from taction.verification.verdict import verify

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Verdict(verify.Verdict):
    """The results of `taction.verify`; ``print`` shows the table of the command.

    The fields are those of `verification.verdict.verify.Verdict`; `outcome` is the overall result.
    """

    __slots__ = ()

    @classmethod
    def of(cls, verdict: verify.Verdict) -> Verdict:
        """Return `verdict` with its table, and its board with its picture."""
        values = {field.name: getattr(verdict, field.name) for field in fields(verdict)}
        return cls(**{**values, "circuit": Circuit.of(verdict.circuit)})

    def __str__(self) -> str:
        from taction.verification.report.renderers.terminal import page_text
        from taction.verification.report.views.verdict import view

        return page_text(view(self))

    def _repr_html_(self) -> str:
        """Return the verdict as a card for a notebook."""
        from taction.verification.report.renderers.notebook import card
        from taction.verification.report.views.verdict import view

        return card(view(self), "Verdict")

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the picture of ``verify --plot``: waveforms, recovered stress and checks.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            The picture cannot be written, or matplotlib is missing (``taction[plot]``).
        """
        from taction.verification.report.renderers.picture import draw_page
        from taction.verification.report.views.verdict import view

        return draw_page(view(self), path)

    def report(self, path: str | Path) -> None:
        """Write a report as one HTML file, with pictures, that needs no network.

        Raises
        ------
        InputError
            The name does not end in ``.html``, the file cannot be written, or a package of
            ``taction[report]`` is missing.

        Examples
        --------
        >>> import taction, tempfile
        >>> verdict = taction.verify("scenes/custom-matrix.toml", engine="statespace")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     verdict.report(f"{folder}/board.html")
        """
        from taction.verification.report.renderers.page import write_page
        from taction.verification.report.views.verdict import view

        write_page(view(self), str(path))
