"""The changes nearest to a scene that are good: outwards over a key, and over pairs of keys.

The values of a key go outwards on both sides, in steps of a fixed ratio. Between two neighbours of
which the farther one passes, or which fail in different checks, the values that can be bought are
halved: some value between a board that is too fast and one that is too slow may pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise, product
from operator import attrgetter
from typing import Any

import numpy as np

from taction.netlist_gen.board.bill_of_materials import buyable, series_of, values_between
from taction.netlist_gen.scene.axes import rising_ends
from taction.netlist_gen.scene.keys import Value, find_key, own_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.verification.design.trials import OutOfWorkError, Trial, Trials
from taction.verification.verdict.cause import following

AT_EDGE = 0.02  # of the logarithmic range: a value so close to an end is at its edge
PER_DECADE, DECADES = 3, 2.0  # values of one key, on both sides of the scene's value
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

    InputError: a key is unknown, not of the design, or has no value; a range is none; too many
      keys.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/tuned-breadboard.toml")
    >>> found = parse_ranges(scene, ["C=10pF:22pF", "gain"], 2.0, 3)
    >>> [(each.path, each.low, each.high) for each in found]
    [('design.capacitance', 1e-11, 2.2e-11), ('design.gain', 1150000.0, 4600000.0)]
    """
    texts = [key.partition("=") for key in keys]
    paths = [find_key(scene, name.strip()).path for name, _, _ in texts]
    if not 1 <= len(set(paths)) == len(paths) <= most:
        text = f"give one to {most} different keys"
        raise InputError("--over", Complaint("keys", repr(",".join(paths)), text))
    return tuple(
        _range(scene, path, body.strip(), reach)
        for path, (_, _, body) in zip(paths, texts, strict=True)
    )


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
    found: list[Trial] = field(default_factory=list)  # the nearest that is good; of a list all
    complete: bool = True  # the work sufficed

    @contextmanager
    def ending_with_the_work(self) -> Iterator[None]:
        """End a search whose work is used up; what it found stays."""
        try:
            yield
        except OutOfWorkError:
            self.complete = False


def search_key(
    trials: Trials,
    path: str,
    edge: float | None = None,
    limits: tuple[float, float] = (0.0, math.inf),
    accept: Accept = is_good,
) -> Search | None:
    """Return the search outwards over a key, on both sides; None if the scene has no value.

    `edge`: end of the stable range nearest to the scene's value: the search begins there, and goes
      away from the scene.
    `limits`: no value beyond them is tried.
    """
    one = SearchRange.around(trials.scene, path, 10.0**DECADES)
    if one is None:
        return None
    begin = one.own if edge is None else edge
    sides = (1.0, -1.0) if edge is None else (math.copysign(1.0, edge - one.own),)
    exponents = np.arange(round(DECADES * PER_DECADE) + 1) / PER_DECADE
    ways = []
    for side in sides:
        values = np.clip(begin * 10.0 ** (side * exponents), *limits).tolist()
        ways.append([one.own, *map(one.bought, values[edge is None :])])
    search = Search((path,), min(map(min, ways)), max(map(max, ways)))
    with search.ending_with_the_work():
        for inner, outer in chain(*zip(*map(pairwise, ways), strict=True)):
            _search_between(trials, search, one, inner, outer, accept)
            if search.found:
                break
    return search


def _search_between(
    trials: Trials, search: Search, one: SearchRange, inner: float, outer: float, accept: Accept
) -> None:
    """Keep the accepted trial nearest to `inner` from there to `outer`, as far as one is seen."""

    def causes(value: float) -> set[tuple[str, bool]]:
        trial = trials.at({one.path: value})
        if accept(trial):
            search.found = [trial]
            return set()
        return _causes(trials.scene, trial)

    failing = causes(outer)
    if inner == outer or failing & _causes(trials.scene, trials.at({one.path: inner})):
        return
    between = values_between(min(inner, outer), max(inner, outer), one.series).tolist()
    values = [value for value in between if value not in (inner, outer)][
        :: 1 if inner < outer else -1
    ]
    while values:
        middle = len(values) // 2
        here = causes(values[middle])
        if not here or failing & here:
            values, failing = values[:middle], here
        else:
            values = values[middle + 1 :]


def search_list(trials: Trials, path: str, values: Iterable[Value]) -> Search:
    """Return the search over listed values of a key, the nearest first."""
    return _search_rows(trials, (path,), [{path: value} for value in values], math.inf)


def search_pair(trials: Trials, paths: tuple[str, str]) -> Search | None:
    """Return the search over two keys together, on a grid; None where a key has no value."""
    ranges = [SearchRange.around(trials.scene, path, 10.0**PAIR_DECADES) for path in paths]
    exponents = np.linspace(-PAIR_DECADES, PAIR_DECADES, PLACES).tolist()
    rows: list[Values] = [
        {
            one.path: one.bought(one.own * 10.0**by)
            for one, by in zip(ranges, pair, strict=True)
            if one
        }
        for pair in sorted(product(exponents, repeat=2), key=lambda pair: math.hypot(*pair))
    ]
    return None if None in ranges else _search_rows(trials, paths, rows, 1)


def _search_rows(
    trials: Trials, paths: tuple[str, ...], rows: Iterable[Values], enough: float
) -> Search:
    """Return the search over changes in their order, until `enough` are good."""
    search = Search(paths)
    with search.ending_with_the_work():
        for row in rows:
            if is_good(trial := trials.at(row)):
                search.found.append(trial)
                if len(search.found) >= enough:
                    break
    return search


def descend(
    objective: Callable[[Values], float],
    ranges: Sequence[SearchRange],
    start: Values,
    spacings: Sequence[float],
) -> Values:
    """Return the values with the least objective that a simplex finds from a start.

    `spacings`: from the start to the first places, of each key, natural logarithm.
    """
    from scipy.optimize import minimize

    best: tuple[float, Values] = (math.inf, start)

    def at(point: Floats) -> float:
        nonlocal best
        values: Values = {
            one.path: one.bought(min(max(math.exp(place), one.low), one.high))
            for one, place in zip(ranges, point.tolist(), strict=True)
        }
        value = objective(values)
        best = min(best, (value, values), key=lambda pair: pair[0])
        return value

    begin = np.log([float(start[one.path]) for one in ranges])
    simplex = np.vstack([begin, begin + np.diag(spacings)])
    options: Any = {"initial_simplex": simplex, "maxfev": EVALUATIONS}
    options |= {"xatol": 1e-3, "fatol": 1e-4}
    minimize(at, begin.tolist(), method="Nelder-Mead", options=options)
    return best[1]


def _causes(scene: Scene, trial: Trial) -> set[tuple[str, bool]]:
    """Return what does not pass, and whether a time is below its `min`; empty if all is good."""

    def is_below(name: str) -> bool:
        least = getattr(getattr(scene.checks, name, None), "min", None)
        value = trial.reading(name)
        return least is not None and value is not None and value < least

    refused = {("parts", False)} if trial.refused else set()
    causes = set(trial.left) - {*following(trial.record.checks)}
    return refused | {(name, is_below(name)) for name in causes}
