"""Searches over values that can be bought: outwards over a key, over pairs of keys, and a simplex.

The values of a key go outwards from the scene's own on both sides, the farther the wider apart, and
the first that passes is the nearest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from operator import attrgetter
from typing import Any

import numpy as np

from taction.netlist_gen.board.bill_of_materials import buyable, series_of
from taction.netlist_gen.scene.axes import rising_ends
from taction.netlist_gen.scene.keys import Value, find_key, own_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.verification.design.trials import OutOfWorkError, Trial, Trials

AT_EDGE = 0.02  # of the logarithmic range: a value so close to an end is at its edge
OUTWARDS, DECADES = 25, 2.0  # values of one key on each side, and how far they go
PAIR_DECADES, PLACES = 1.2, 7  # of two keys: on both sides, and values of each
EVALUATIONS = 40  # of one simplex

Values = dict[str, Value]
Accept = Callable[[Trial], bool]


is_good: Accept = attrgetter("good")
"""Whether every check passes with parts that can be bought."""


@dataclass(frozen=True, slots=True)
class SearchRange:
    """The values of one key, above zero, that can be bought."""

    path: str
    unit: str
    own: float  # the scene's value
    low: float  # ends of the range
    high: float
    series: str  # of the values; "exact" for all numbers of three digits

    @classmethod
    def around(cls, scene: Scene, path: str, factor: float) -> SearchRange | None:
        """Return the range from the scene's value / `factor` to its value * `factor`.

        None if the scene has no value above zero.
        """
        key = find_key(scene, path)
        own = own_value(scene, key) if key.kind == "real" else None
        if own is None or not 0.0 < own < math.inf:
            return None
        series = series_of(scene.design, key.path)
        return cls(key.path, key.unit, own, own / factor, own * factor, series)

    def bought(self, value: float) -> float:
        """Return the nearest value that can be bought."""
        return buyable(value, self.series)

    def values(self, points: int) -> tuple[float, ...]:
        """Return values with logarithmic spacing from `low` to `high`, each once."""
        spaced = np.geomspace(self.low, self.high, points if self.low < self.high else 1)
        return tuple(dict.fromkeys(map(self.bought, spaced.tolist())))

    def outwards(self, begin: float | None = None) -> tuple[float, ...]:
        """Return the values on both sides, the nearest first; from `begin` away from the own."""
        start = self.own if begin is None else begin
        sides = (1.0, -1.0) if begin is None else (math.copysign(1.0, start - self.own),)
        away = (DECADES * (k / OUTWARDS) ** 1.5 for k in range(OUTWARDS + 1))  # 4 % to 32 % apart
        tried = [self.bought(start * 10.0 ** (side * by)) for by in away for side in sides]
        return tuple(value for value in dict.fromkeys(tried) if value != self.own)

    def edge_of(self, value: float) -> float | None:
        """Return the end of the range at which `value` lies, or None."""
        close = (self.high / self.low) ** AT_EDGE
        if value <= self.low * close:
            return self.low
        return self.high if value >= self.high / close else None


def parse_ranges(
    scene: Scene, keys: Iterable[str], reach: float, most: int
) -> tuple[SearchRange, ...]:
    """Return the ranges of one to `most` keys: ``"gain"`` or ``"gain=1M:10M"``.

    A key without a range goes from the scene's value divided by `reach` to the value times it.
    InputError: a key is unknown, not of the design, or has no value; a range is none.
    """
    texts = [key.partition("=") for key in keys]
    paths = [find_key(scene, name.strip()).path for name, _, _ in texts]
    if not 1 <= len(set(paths)) == len(paths) <= most:
        text = f"give one to {most} different keys"
        raise InputError("--over", Complaint("keys", repr(",".join(paths)), text))
    bodies = (body.strip() for _, _, body in texts)
    return tuple(_range(scene, *pair, reach) for pair in zip(paths, bodies, strict=True))


def _range(scene: Scene, path: str, body: str, reach: float) -> SearchRange:
    if not path.startswith("design."):
        text = "only the design can be tuned, such as gain, capacitance or unit_conductance"
        raise InputError("--over", Complaint(path, "", text))
    if find_key(scene, path).kind == "choice":
        text = "a search needs a key with numbers; `taction sweep` tries names"
        raise InputError("--over", Complaint("axis", repr(f"{path}={body}"), text))
    found = SearchRange.around(scene, path, reach)
    if found is None:
        text = "the scene has no value above zero of this key, from which the search could start"
        own = own_value(scene, find_key(scene, path))
        raise InputError("--over", Complaint(path, repr(own), text))
    if not body:
        return found
    low, high = rising_ends(scene, path, body)
    return replace(found, low=low, high=high)


@dataclass(slots=True)
class Search:
    """The search over one key or over two, and what it found."""

    DOCUMENT = ("keys = paths", "from = least", "to = most")

    paths: tuple[str, ...]
    least: float | None = None  # ends of the values that are tried, of one key with a range
    most: float | None = None
    found: list[Trial] = field(default_factory=list)  # those that are accepted
    complete: bool = True  # the work sufficed


def search(
    trials: Trials,
    found: Search,
    rows: Iterable[Values],
    enough: float = 1,
    accept: Accept = is_good,
) -> Search:
    """Try changes in their order, until `enough` of them are accepted or the work is used up."""
    try:
        for row in rows:
            if accept(trial := trials.at(row)):
                found.found.append(trial)
                if len(found.found) >= enough:
                    break
    except OutOfWorkError:
        found.complete = False
    return found


def search_key(
    trials: Trials, path: str, begin: float | None = None, accept: Accept = is_good
) -> Search | None:
    """Return the search outwards over a key; None if the scene has no value above zero.

    `begin`: end of the stable range nearest to the scene's value; the search goes away from it.
    """
    one = SearchRange.around(trials.scene, path, 1.0)
    if one is None:
        return None
    values = one.outwards(begin)
    ends = Search((path,), min(one.own, *values), max(one.own, *values))
    return search(trials, ends, ({path: value} for value in values), accept=accept)


def search_pair(trials: Trials, paths: tuple[str, str]) -> Search | None:
    """Return the search over two keys together, on a grid; None where a key has no value."""
    ranges = [SearchRange.around(trials.scene, path, 10.0**PAIR_DECADES) for path in paths]
    first, second = ranges
    if first is None or second is None:
        return None

    def rows() -> Iterator[Values]:
        exponents = np.linspace(-PAIR_DECADES, PAIR_DECADES, PLACES).tolist()
        for a, b in sorted(product(exponents, repeat=2), key=lambda pair: math.hypot(*pair)):
            values = first.bought(first.own * 10.0**a), second.bought(second.own * 10.0**b)
            yield dict(zip(paths, values, strict=True))

    return search(trials, Search(paths), rows())


def descend(
    objective: Callable[[Values], float],
    ranges: Sequence[SearchRange],
    start: Values,
    spacings: Sequence[float],
) -> None:
    """Search the values with the least objective by a simplex from a start.

    `spacings`: from the start to the first places, of each key, natural logarithm.
    """
    from scipy.optimize import minimize

    def at(point: Floats) -> float:
        return objective(
            {
                one.path: one.bought(min(max(math.exp(place), one.low), one.high))
                for one, place in zip(ranges, point.tolist(), strict=True)
            }
        )

    begin = np.log([float(start[one.path]) for one in ranges])
    options: Any = {"maxfev": EVALUATIONS, "xatol": 1e-3, "fatol": 1e-4}
    options["initial_simplex"] = np.vstack([begin, begin + np.diag(spacings)])
    minimize(at, begin.tolist(), method="Nelder-Mead", options=options)
