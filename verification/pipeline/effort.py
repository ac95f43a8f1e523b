"""What a verification computes: everything for a designer, the least for one point of a study."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """What a verification computes beside the checks.

    Attributes
    ----------
    details : bool
        The figures of the constraint plane, the error budget, times on the continuous solution
        and the ringing of settled channels.
    full_margin : bool
        The stability margin as far as the scan goes, not only as far as the scene's check asks.
    session : bool
        The run is one of many: one ngspice takes deck after deck (`engines.ngspice.session`).
    """

    details: bool = True
    full_margin: bool = True
    session: bool = False


FULL = Effort()
