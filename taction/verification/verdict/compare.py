"""Two records of verdicts beside each other: one comparison for every study.

What may differ is the caller's `Tolerance`: the uncertainties of both (`within_uncertainties`), the
tolerances of a scene, or the error that a scene allows beside a true value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from taction.verification.verdict.cause import band_text, boards_text
from taction.verification.verdict.checks import Check
from taction.verification.verdict.record import CHANNEL_FIGURES, FIGURES, Figure, Record, finite

Group = str
"""``"outcome"``, ``"checks"`` and ``"states"`` are words, ``"values"`` are those of checks,
``"figures"`` of the board, ``"channels"`` of one output, ``"waveforms"`` norms of outputs."""
GROUPS: tuple[Group, ...] = ("outcome", "checks", "values", "states", "figures", "channels")


@dataclass(frozen=True, slots=True)
class Difference:
    """One quantity of two records."""

    SHOWN: ClassVar[tuple[str, ...]] = ("beyond",)

    group: Group
    name: str
    channel: int | None  # from 1; None for a quantity of the board
    # `first`, `second`: the quantity in `unit`, a word (an outcome, a state), or None where there
    # is none.
    first: float | str | None
    second: float | str | None
    unit: str
    difference: float | None  # second minus first; None where one of them is no number
    # How large the difference may be; None where that is unknown, or where both must be equal.
    allowed: float | None
    # Magnitude of the difference over what is allowed; infinite where the two cannot be compared,
    # not a number where what is allowed is unknown.
    off: float
    # More about the difference, such as where it is largest; of a settling time its bands.
    note: str = ""

    @property
    def label(self) -> str:
        """What is compared, in words: ``"check stability"``, ``"u_1.final"``."""
        if self.group in ("checks", "waveforms"):
            return f"{self.group.removesuffix('s')} {self.name}"
        if self.channel is None:
            return self.name
        node = f"u_{self.channel}"
        return f"state {node}" if self.group == "states" else f"{node}.{self.name}"

    @property
    def beyond(self) -> bool | None:
        """Whether the difference is larger than what is allowed; None where that is unknown."""
        return None if math.isnan(self.off) else not self.off <= 1.0


Tolerance = Callable[[str, Figure, Figure], float | None]
"""Of a quantity's name, its value in both records: the allowed difference; None: unknown."""


def within_uncertainties(times: float = 1.0) -> Tolerance:
    """Return the tolerance of `times` the sum of both uncertainties, which are bounds."""

    def allowed(name: str, first: Figure, second: Figure) -> float | None:
        if first.uncertainty is None or second.uncertainty is None:
            return None
        return times * (first.uncertainty + second.uncertainty)

    return allowed


Row = tuple[Group, str, int | None]
"""Group, name and channel of a quantity."""
WORDS = ("outcome", "checks", "states")


def compare(
    first: Record,
    second: Record,
    tolerance: Tolerance,
    *,
    groups: Collection[Group] = GROUPS,
    figures: Sequence[str] = tuple(FIGURES),
    channel_figures: Sequence[str] = (*CHANNEL_FIGURES, "equilibrium"),
) -> tuple[Difference, ...]:
    """Compare every quantity that either record has.

    A word must be equal. Of a fragile time the nearest of its two values counts.

    `tolerance`: the difference that is allowed.
    `groups`: what is compared, of `GROUPS`.
    `figures`, `channel_figures`: the figures of the board and of the channels that are compared.

    Examples
    --------
    >>> record = Record("pass", "statespace", figures={"rise_time": 1.0})
    >>> other = replace(record, figures={"rise_time": 2.0})
    >>> found = compare(record, other, lambda name, a, b: 2.0, groups=("figures",))
    >>> found[0].name, found[0].off, found[0].beyond
    ('rise_time', 0.5, False)
    """
    one, two = (dict(_rows(each, figures, channel_figures)) for each in (first, second))
    bands = _of_both(band_text, first, second)
    notes = {("values", "steady_state"): _of_both(boards_text, first, second)}
    notes |= {(group, "settling_time"): bands for group in ("values", "figures", "channels")}
    found = []
    for row in {**one, **two}:
        a, b = one.get(row), two.get(row)
        if row[0] in WORDS:
            found.append(words(*row, *(None if each is None else str(each) for each in (a, b))))
        else:
            one_of, two_of = (each if isinstance(each, Figure) else Figure(None) for each in (a, b))
            made = numbers(*row, one_of, two_of, tolerance)
            found.append(replace(made, note=notes.get(row[:2], "")))
    return tuple(each for each in found if each.group in groups)


def _rows(
    record: Record, figures: Sequence[str], channel_figures: Sequence[str]
) -> Iterator[tuple[Row, Figure | str]]:
    """Yield every quantity of a record: a word, or a figure; no figure that it lacks."""
    yield ("outcome", "outcome", None), record.outcome
    for check in record.checks:
        yield ("checks", check.name, None), check.outcome.value
        value = Figure(finite(check.value), check.unit, finite(check.uncertainty))
        yield ("values", check.name, None), value
    for name in figures:
        if (figure := record.figure(name)).value is not None:
            yield ("figures", name, None), figure
    for channel in record.channels:
        yield ("states", "state", channel.index), channel.state
        for name in channel_figures:
            if (figure := channel.figure(name)).value is not None:
                yield ("channels", name, channel.index), figure


def _of_both(text: Callable[[Check], str], first: Record, second: Record) -> str:
    """Return what the checks of two records say, once where they say the same."""
    texts = ("".join(map(text, record.checks)) for record in (first, second))
    known = [*dict.fromkeys(filter(None, texts))]
    return "A {}, B {}".format(*known) if len(known) > 1 else "".join(known)


def words(
    group: Group, name: str, channel: int | None, first: str | None, second: str | None
) -> Difference:
    """Return the difference of two words, which must be equal."""
    off = 0.0 if first == second else math.inf
    return Difference(group, name, channel, first, second, "", None, None, off)


def numbers(
    group: Group,
    name: str,
    channel: int | None,
    first: Figure,
    second: Figure,
    tolerance: Tolerance,
) -> Difference:
    """Return the difference of two numbers, of fragile ones that of the nearest values."""
    unit = first.unit or second.unit
    made = Difference(group, name, channel, first.value, second.value, unit, None, None, math.inf)
    if first.value is None or second.value is None:
        same = _may_be_missing(first) and _may_be_missing(second)
        return replace(made, off=0.0) if same else made
    allowed = tolerance(name, first, second)
    pairs = [(first.value, b) for b in _values(second)]
    pairs += [(a, second.value) for a in _values(first)]
    one, two = min(pairs, key=lambda pair: abs(pair[1] - pair[0]))
    off = relative(abs(two - one), allowed)
    return replace(made, first=one, second=two, difference=two - one, allowed=allowed, off=off)


def relative(distance: float, allowed: float | None) -> float:
    """Return a distance over what is allowed; a distance of 0 is always allowed."""
    if distance == 0.0:
        return 0.0
    if allowed is None:
        return math.nan
    return distance / allowed if allowed > 0.0 else math.inf


def _may_be_missing(figure: Figure) -> bool:
    return figure.value is None or (figure.fragile and figure.alternative is None)


def _values(figure: Figure) -> Iterator[float]:
    return (v for v in (figure.value, figure.alternative) if v is not None)
