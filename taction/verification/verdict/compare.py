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
    """One quantity of two records.

    Attributes
    ----------
    channel : int or None
        From 1; None for a quantity of the board.
    first, second : float, str or None
        The quantity in `unit`, a word (an outcome, a state), or None where there is none.
    difference : float or None
        Second minus first; None where one of them is no number.
    allowed : float or None
        How large the difference may be; None where that is unknown, or where both must be equal.
    off : float
        Magnitude of the difference over what is allowed; infinite where the two cannot be compared,
        not a number where what is allowed is unknown.
    note : str
        More about the difference, such as where it is largest; of a settling time its bands.
    """

    SHOWN: ClassVar[tuple[str, ...]] = ("beyond",)

    group: Group
    name: str
    channel: int | None
    first: float | str | None
    second: float | str | None
    unit: str
    difference: float | None
    allowed: float | None
    off: float
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

    Parameters
    ----------
    tolerance : callable
        The difference that is allowed.
    groups : collection of str, optional
        What is compared, of `GROUPS`.
    figures, channel_figures : sequence of str, optional
        The figures of the board and of the channels that are compared.

    Examples
    --------
    >>> record = Record("pass", "statespace", figures={"rise_time": 1.0})
    >>> other = replace(record, figures={"rise_time": 2.0})
    >>> found = compare(record, other, lambda name, a, b: 2.0, groups=("figures",))
    >>> found[0].name, found[0].off, found[0].beyond
    ('rise_time', 0.5, False)
    """
    found: list[Difference] = []
    if "outcome" in groups:
        found.append(words("outcome", "outcome", None, first.outcome, second.outcome))
    found += _checks(first, second, tolerance, groups)
    if "figures" in groups:
        for name in figures:
            pair = first.figure(name), second.figure(name)
            if pair[0].value is not None or pair[1].value is not None:
                found.append(numbers("figures", name, None, *pair, tolerance))
    found += _channels(first, second, tolerance, groups, channel_figures)
    notes = {
        ("values", "steady_state"): _of_both(boards_text, first, second),
        ("values", "settling_time"): (bands := _of_both(band_text, first, second)),
        ("figures", "settling_time"): bands,
        ("channels", "settling_time"): bands,
    }
    return tuple(replace(d, note=notes.get((d.group, d.name), d.note)) for d in found)


def _of_both(text: Callable[[Check], str], first: Record, second: Record) -> str:
    """Return what the checks of two records say, once where they say the same."""
    texts = ("".join(map(text, record.checks)) for record in (first, second))
    known = [*dict.fromkeys(filter(None, texts))]
    return "A {}, B {}".format(*known) if len(known) > 1 else "".join(known)


def _checks(
    first: Record, second: Record, tolerance: Tolerance, groups: Collection[Group]
) -> Iterator[Difference]:
    one, two = ({check.name: check for check in each.checks} for each in (first, second))
    for name in {**one, **two}:
        pair = one.get(name), two.get(name)
        if "checks" in groups:
            outcomes = [None if check is None else check.outcome.value for check in pair]
            yield words("checks", name, None, outcomes[0], outcomes[1])
        if "values" in groups:
            yield numbers("values", name, None, _stated(pair[0]), _stated(pair[1]), tolerance)


def _stated(check: Check | None) -> Figure:
    if check is None:
        return Figure(None)
    return Figure(finite(check.value), check.unit, finite(check.uncertainty))


def _channels(
    first: Record,
    second: Record,
    tolerance: Tolerance,
    groups: Collection[Group],
    figures: Sequence[str],
) -> Iterator[Difference]:
    one, two = ({channel.index: channel for channel in each.channels} for each in (first, second))
    for index in {**one, **two}:
        a, b = one.get(index), two.get(index)
        if "states" in groups:
            states = [None if each is None else each.state for each in (a, b)]
            yield words("states", "state", index, states[0], states[1])
        for name in figures if "channels" in groups else ():
            pair = [Figure(None) if each is None else each.figure(name) for each in (a, b)]
            if pair[0].value is not None or pair[1].value is not None:
                yield numbers("channels", name, index, pair[0], pair[1], tolerance)


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
