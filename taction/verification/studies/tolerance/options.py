"""What the options of tolerance studies say; a mistake is found before anything that computes."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING

from taction.system.errors import Complaint, InputError
from taction.system.quantities import fraction

if TYPE_CHECKING:
    from taction.netlist_gen.board.variation import Parameter


def half_width(until: str | float | None) -> float | None:
    """Return the requested half width of the confidence interval, from ``"1%"`` or 0.01.

    Raises
    ------
    InputError
        The half width is not between 0 and 0.5.
    """
    if until is None:
        return None
    try:
        value = fraction(until)
    except ValueError:
        value = 0.0
    if not 0 < value < 0.5:
        accepted = "expected a half width such as 1% or 0.01"
        raise InputError("--until", Complaint("WIDTH", repr(until), accepted))
    return value


def refuse_unknown(varied: Collection[Parameter], ends: Iterable[str]) -> None:
    """Refuse a key that names neither a component of `varied` nor a kind of these.

    Raises
    ------
    InputError
        The message has the kinds.
    """
    kinds = {parameter.kind for parameter in varied}
    known = kinds.union(parameter.name for parameter in varied)
    for key in ends:
        if key not in known:
            text = f"neither a component that varies nor one of {', '.join(sorted(kinds))}"
            raise InputError("--corner", Complaint(key, "", text))


def deviations_of(corner: str | Mapping[str, float]) -> tuple[str, Mapping[str, float]]:
    """Return the name of a corner and its deviations, in units of the tolerances.

    Raises
    ------
    InputError
        A part of the text is not ``KEY=Z``, or Z is not from -100 to 100.

    Examples
    --------
    >>> deviations_of("capacitor=-1,opamp_gbw=0.5")[1]
    {'capacitor': -1.0, 'opamp_gbw': 0.5}
    """
    if not isinstance(corner, str):
        return ",".join(f"{key}={value:g}" for key, value in corner.items()), corner
    deviations = {}
    for part in corner.split(","):
        name, _, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = math.inf
        if not abs(number) <= 100:
            accepted = "expected KEY=Z, Z from -100 to 100 in units of the tolerance: capacitor=-1"
            raise InputError("--corner", Complaint("KEY=Z", repr(part), accepted))
        deviations[name.strip()] = number
    return corner, deviations
