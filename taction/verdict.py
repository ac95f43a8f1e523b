"""`Verdict` as the door hands it out: the verdict of `verification.verify`, which prints itself.

The table of a verdict is a report, and reports stand above the pipeline that makes verdicts.
"""

from __future__ import annotations

from dataclasses import fields

from verification import verify


class Verdict(verify.Verdict):
    """Everything that `taction.verify` found; ``print`` shows the table that the command prints.

    Its fields are those of `verification.verify.Verdict`; `outcome` sums them up.
    """

    __slots__ = ()

    @classmethod
    def of(cls, found: verify.Verdict) -> Verdict:
        """Return the verdict `found` with its table."""
        return cls(*(getattr(found, field.name) for field in fields(found)))

    def __str__(self) -> str:
        from verification.report.verdict.table import verdict_text

        return verdict_text(self)
