"""The readings of a transient: what each is called, what it means, and the numbers that define it.

`READINGS` is the one table: measures, checks, figures, documents, tables and pictures loop over it.
With the network's step amplitude ``A = max_n |target_n - start_n|``, its sentences are the
definitions for the whole tool. The numbers are conventions, not results, so the reference solver
and the measures may share them.
"""

from __future__ import annotations

from dataclasses import dataclass

SETTLING_BAND = 0.01  # of A: half width of the settling band where a scene gives none
RISE_LEVELS = (0.1, 0.9)  # of a channel's own step
SMALL_STEP = 0.05  # of A: a channel with a smaller step has no rise time
LEVEL_SHIFT = 0.005  # of a channel's step: how far rise levels are moved to find a fragile reading
BAND_SHIFT = 0.05  # of the settling band: how far its edge is moved for the same
FRAGILE = 0.1  # of a time: a change that makes it fragile
FOUND = 1e-6  # of A: error to which an excursion is found, if no limit is nearer
FAINT = 1e-5  # of A: a mode with a smaller share does not ring in a channel


@dataclass(frozen=True, slots=True)
class ReadingKind:
    """One kind of reading."""

    unit: str  # ``"s"``, or ``"step"``: a fraction of A
    short: str  # title of its column in a table of channels
    sentence: str  # what it is
    # Which small shift finds a fragile reading; empty for a kind that has no level to shift.
    shifted: str = ""


READINGS: dict[str, ReadingKind] = {
    "rise_time": ReadingKind(
        "s",
        "rise",
        "from 10 % to 90 % of a channel's own step, first crossings; undefined for a step under"
        " 5 % of A",
        f"the level shifted by {LEVEL_SHIFT:.1%} of the step",
    ),
    "settling_time": ReadingKind(
        "s",
        "settling",
        "the last instant at which any channel is outside ±x % of A around its target",
        f"the band {BAND_SHIFT:.0%} wider or narrower",
    ),
    "overshoot": ReadingKind(
        "step",
        "over",
        "how far a channel goes beyond its target, away from its start, as a fraction of A; of a"
        " channel whose own step is under 5 % of A, how far outside the interval between start and"
        " target on either side",
    ),
    "undershoot": ReadingKind(
        "step",
        "under",
        "how far a channel goes beyond its start, away from its target, as a fraction of A; a"
        " channel whose own step is under 1e-6 A has no direction: both sides count",
    ),
}
TIMES = tuple(name for name, kind in READINGS.items() if kind.unit == "s")
EXCURSIONS = tuple(name for name, kind in READINGS.items() if kind.unit == "step")
