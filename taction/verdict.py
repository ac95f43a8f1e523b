"""`taction.Verdict`: the verdict of `verification.verify` with its table as text.

The table is a report, and the pipeline that makes verdicts must not import reports.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from verification import verify


class Verdict(verify.Verdict):
    """The results of `taction.verify`; ``print`` shows the table of the command.

    The fields are those of `verification.verify.Verdict`; `outcome` is the overall result.
    """

    __slots__ = ()

    @classmethod
    def of(cls, verdict: verify.Verdict) -> Verdict:
        """Return `verdict` with its table."""
        return cls(*(getattr(verdict, field.name) for field in fields(verdict)))

    def __str__(self) -> str:
        from verification.report.verdict.table import verdict_text

        return verdict_text(self)

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
        from verification.report.html.verdict_report import write_verdict_report

        write_verdict_report(self, str(path))
