"""Extent of a verification: all results for a designer, only the checks for a point of a study."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """Results that a verification computes in addition to the checks.

    No outcome and no reading of a check depends on these choices.

    Attributes
    ----------
    details : bool
        Whether to compute the figures of the constraint plane, the error budget and the energy.
    full_margin : bool
        Whether to scan the stability margin up to `REACH`, not only up to the limit of the scene.
    """

    details: bool = True
    full_margin: bool = True


FULL = Effort()
