"""How much trouble a verification goes to: one for a designer to read, or one of ten thousand."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """What a verification leaves out where nobody asks for it.

    Attributes
    ----------
    details : bool
        False: without what no check needs, the constraint plane's figures, the error budget,
        times on the continuous solution and the ringing of channels that have settled.
    full_margin : bool
        False: the stability margin is looked for only as far as the scene's check wants it.
    session : bool
        True: one of many, so that one ngspice takes deck after deck (`engines.session`).
    """

    details: bool = True
    full_margin: bool = True
    session: bool = False


FULL = Effort()
