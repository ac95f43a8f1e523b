"""The panels that the pictures of a sweep share: quantities, outcomes, what fails."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np

from taction.system.array_types import Floats
from taction.system.plugins import OpenTable
from taction.system.reading_definitions import EXCURSIONS
from taction.verification.report.picture import BLUE, GREY, HATCHES, ORANGE, PURPLE
from taction.verification.report.sweep.records import all_records
from taction.verification.report.tables import spaced
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan
from taction.verification.verdict.record import FIGURES

# of a check that fails, the same in every picture
FAILS = {
    "stability": (ORANGE, "////"),
    "settling time": ("#e69f00", "\\\\\\\\"),
    "overshoot": ("#f5c98a", "xxxx"),
    "steady state": ("#8f3f00", "++++"),
}
OTHER_FAILS = (("#b8860b", "||||"), ("#f0e442", "----"), ("#a0522d", "oo"))
LINEAR = 0.1  # of the largest rate: about up to there the scale of rates is linear
LEAST_PER_CENT = 1e-4  # of the step: below lies rounding
LITTLE = "under 1 ppm of the step"
ENGINES = OpenTable(
    "taction.engines", {"ngspice": "ngspice", "statespace": "state space"}, str, "title"
)
"""Names of the engines for people."""
MISSING = ""


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel: a figure of the records, its title, its factor and the kind of its scale."""

    name: str
    title: str
    factor: float
    scale: str

    def is_rounding(self, values: Floats) -> bool:
        """Whether all known values, as drawn, are too small a share of the step for a picture."""
        known = values[np.isfinite(values)]
        return self.factor > 1.0 and len(known) > 0 and float(known.max()) < LEAST_PER_CENT

    @property
    def unit(self) -> str:
        """Unit of what is drawn; the title says where that is per cent of the step."""
        unit = FIGURES[self.name].unit
        return "" if unit == "step" else unit


PANELS = (
    Panel("settling_time", "settling time", 1.0, "log"),
    *(Panel(name, f"{name} (% of the step)", 100.0, "linear") for name in EXCURSIONS),
    Panel("steady_state_error", "steady-state error (% of the step)", 100.0, "log"),
    Panel("growth_rate", "rightmost pole, real part", 1.0, "symlog"),
)


def linear_part(reach: float) -> float:
    """Return the rate up to which a scale to ±`reach` is linear: a decade, where a tick stands.

    Examples
    --------
    >>> linear_part(35e3), linear_part(9999.0)
    (10000.0, 1000.0)
    """
    return float(10.0 ** math.ceil(math.log10(LINEAR * reach)))


def rate_ticks(reach: float) -> list[float]:
    """Return the ticks of a scale of rates to ±`reach`: zero and decades, none near another.

    Examples
    --------
    >>> rate_ticks(35e3), rate_ticks(2e4)
    ([-10000.0, 0.0, 10000.0], [-10000.0, 0.0, 10000.0])
    """
    least = linear_part(reach)
    upper = [least * 10.0**k for k in range(2) if least * 10.0**k <= 1.001 * reach]
    return [*(-tick for tick in upper[::-1]), 0.0, *upper]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of result with its colour and hatching."""

    name: str
    colour: str
    hatch: str


def result_names(plan: Plan, store: Store) -> np.ndarray[Any, Any]:
    """Return what each point and engine says, as words over the grid, the engine last.

    ``"pass"``, ``"fail: stability"``, ``"inconclusive: rise time"``, ``"error: TimedOut"``; empty
    for a point without a result. Of several checks the first one counts, stability before all.
    """
    shape = (*plan.shape, len(plan.engines))
    names = np.full(shape, MISSING, dtype=object)
    for place, record in zip(np.ndindex(*shape), all_records(plan, store), strict=True):
        if record is not None:
            names[place] = _name(record)
    return names


def _name(record: dict[str, Any]) -> str:
    outcome: str = record["outcome"]
    if outcome == "error":
        return f"error: {record['failure']}"
    found = [check["name"] for check in record["checks"] if check["outcome"] == outcome]
    if outcome == "pass" or not found:
        return outcome
    return f"{outcome}: {spaced('stability' if 'stability' in found else found[0])}"


def kinds_of(names: Iterable[str]) -> tuple[Kind, ...]:
    """Return the kinds that occur, the most frequent ones of each outcome first."""
    count = Counter(names)
    count.pop(MISSING, None)
    others = cycle(OTHER_FAILS)
    unknown, broken = cycle(("....", "oo", "")), cycle(("xxxx", "**"))
    kinds = []
    for outcome in ("pass", "fail", "inconclusive", "error"):
        for name, _ in count.most_common():
            if name.partition(":")[0] != outcome:
                continue
            check = name.partition(": ")[2]
            if outcome == "pass":
                colour, hatch = BLUE, HATCHES["pass"]
            elif outcome == "fail":
                colour, hatch = FAILS[check] if check in FAILS else next(others)
            elif outcome == "inconclusive":
                colour, hatch = GREY, next(unknown)
            else:
                colour, hatch = PURPLE, next(broken)
            kinds.append(Kind(name, colour, hatch))
    return tuple(kinds)
