"""What a user asks of a board without a scene: limits of readings, and expected values.

The table of limits, which loads pydantic, is made where there are limits, or where it is needed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from taction.system.errors import Complaint, InputError
from taction.system.quantities import fraction, parse

if TYPE_CHECKING:
    from taction.netlist_gen.scene.checks import Checks

SHARE = 1e-3  # default tolerance of an expected value
LISTED = 20  # nodes in a message
LARGEST = 100.0  # factor of a value up to which `stability.margin` searches
OSCILLATES = "oscillates"
NAMES = {
    "settling": "settling_time", "rise": "rise_time", "margin": "stability",
    "stable": "stability", "agree": "engines_agree",
}  # fmt: skip
"""Short names of checks."""
LIMITED = ("settling_time", "rise_time", "overshoot", "undershoot", "noise", "stability")


class Expected(NamedTuple):
    """An expected voltage at rest."""

    node: str
    volts: float
    tolerance: float  # accepted deviation, V


@dataclass(frozen=True)
class Wanted:
    """What is to be checked.

    Attributes
    ----------
    tables : mapping of str to mapping
        What is asked of each reading, by the name of its check.
    expected : tuple of Expected
        Voltages at rest.
    oscillates : bool
        Whether the circuit has to oscillate. Without this it has to be stable.
    """

    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    expected: tuple[Expected, ...] = ()
    oscillates: bool = False

    @cached_property
    def limits(self) -> Checks:
        """All limits, those of a scene without checks where nothing is asked."""
        from taction.netlist_gen.scene.checks import Checks
        from taction.netlist_gen.scene.mistakes import validated

        return validated(Checks, self.tables, "--check")

    @property
    def names(self) -> tuple[str, ...]:
        """The checks that are asked for."""
        return (*self.tables, *(() if self.oscillates else ("stability",)))

    def refuse_unknown(self, nodes: Collection[str]) -> None:
        """Refuse an expected value of a node that is not one of `nodes`."""
        for each in self.expected:
            if each.node not in nodes:
                text = f"the board has the nodes {', '.join([*nodes][:LISTED])}"
                raise InputError("--expect", Complaint(f"v({each.node})", "", text))

    @property
    def lowest(self) -> float | None:
        """Lowest frequency of the noise, Hz, where it was given."""
        return None if self.limits.noise is None else self.limits.noise.lowest


def wanted(checks: Iterable[str] = (), expect: Iterable[str] = ()) -> Wanted:
    """Read the texts of checks and expected values.

    Raises
    ------
    InputError
        A text that is no check; it says what is accepted.

    Examples
    --------
    >>> found = wanted(["settling=1ms@1%", "margin=2"], ["v(out)=1.25@0.1%"])
    >>> found.limits.settling_time.max, found.limits.stability.margin, found.expected
    (0.001, 2.0, (Expected(node='out', volts=1.25, tolerance=0.00125),))
    """
    tables: dict[str, dict[str, Any]] = {}
    for text in checks:
        name, keys = _check_of(text)
        known = tables.setdefault(name, {})
        if any(known.get(key, value) != value for key, value in keys.items()):
            raise InputError("--check", Complaint(name, repr(text), "two limits of one reading"))
        known.update(keys)
    oscillates = tables.pop(OSCILLATES, None) is not None
    found = Wanted(tables, tuple(map(_expected, expect)), oscillates)
    if tables:
        _ = found.limits  # a wrong one is refused here
    return found


def _check_of(text: str) -> tuple[str, dict[str, Any]]:
    word, _, value = (part.strip() for part in text.partition("="))
    value, _, extra = (part.strip() for part in value.partition("@"))
    name = NAMES.get(word, word)
    if name not in (*LIMITED, "engines_agree", OSCILLATES):
        known = "settling=1ms@1%, rise=10us, overshoot=5%, undershoot=5%, noise=1mV, margin=2"
        text = f"expected a check such as {known}, stable, oscillates, agree=1e-3"
        raise InputError("--check", Complaint("check", repr(word), text))
    if name in (OSCILLATES, "stability") and not value and word != "margin":
        return name, {}
    if name == OSCILLATES:
        raise InputError("--check", Complaint(word, repr(value), "expected no value"))
    if name == "stability":
        return name, {"margin": _factor(word, value)}
    if name == "engines_agree":
        return name, {"tolerance": share_of(value)}
    if not value:
        raise InputError("--check", Complaint(word, "", f"expected a limit, such as {word}=1"))
    keys: dict[str, Any] = {
        "max": share_of(value) if name in ("overshoot", "undershoot") else value
    }
    if extra and name == "settling_time":
        keys["band"] = share_of(extra)
    elif extra and name == "noise":
        keys["lowest"] = extra
    elif extra:
        text = "only settling=LIMIT@BAND and noise=LIMIT@LOWEST have a second value"
        raise InputError("--check", Complaint(word, repr(extra), text))
    return name, keys


def _factor(word: str, text: str) -> float:
    try:
        factor = float(text)
        if not 1.0 <= factor <= LARGEST:
            raise ValueError("margins are searched up to this factor")
        return factor
    except ValueError:
        accepted = f"expected a factor from 1 to {LARGEST:g}, such as {word}=2"
        raise InputError("--check", Complaint(word, repr(text), accepted)) from None


def share_of(text: str, option: str = "--check") -> float:
    """Return a fraction from ``5%`` or ``0.05``.

    Raises
    ------
    InputError
        It is neither, negative or without a limit.
    """
    try:
        share = fraction(text)
        if not 0.0 <= share < math.inf:
            raise ValueError("a share is finite and not negative")
        return share
    except ValueError:
        accepted = "expected a share such as 5% or 0.05"
        raise InputError(option, Complaint("share", repr(text), accepted)) from None


def _expected(text: str) -> Expected:
    name, _, value = (part.strip() for part in text.partition("="))
    value, at, tolerance = (part.strip() for part in value.partition("@"))
    node = name.lower().removeprefix("v(").removesuffix(")")
    try:
        volts = parse(value, "V")
        if not at or tolerance.endswith("%"):
            share = share_of(tolerance, "--expect") if at else SHARE
            accepted = share * abs(volts)
        else:
            accepted = parse(tolerance, "V")
        if not 0.0 <= accepted < math.inf:
            raise ValueError("a tolerance is finite and not negative")
        return Expected(node, volts, accepted)
    except ValueError as error:
        usual = f"{error}; expected v(NODE)=VALUE@TOLERANCE, such as v(out)=1.25@0.1%"
        raise InputError("--expect", Complaint("value", repr(text), usual)) from None
