"""The changes nearest to a scene that are good: one walk outwards over keys, and pairs of keys.

All keys are walked together, in steps of a fixed ratio, on both sides. Between two neighbours of
which the farther one passes, or which fail in different checks, the values that can be bought are
halved: some value between a board that is too fast and one that is too slow may pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
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
PAIR_DECADES, SPACING = 1.5, 0.5  # of two keys: on both sides, and between the first places
EVALUATIONS = 40  # of one simplex
FAR = 5.0  # of a check without a value, such as those of an unstable board
LEAST_MISS = 1e-3  # of a check whose value is at its limit, and does not pass
LINE = 64  # places of two keys between two changes

Values = dict[str, Value]
Accept = Callable[[Trial], bool]


def is_good(trial: Trial) -> bool:
    """Whether every check passes with parts that can be bought."""
    return trial.good


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
    ranges: tuple[SearchRange, ...] = ()  # the keys; empty for a list of values
    ways: list[list[Values]] = field(default_factory=list)  # in a row, the nearest change first
    found: list[Trial] = field(default_factory=list)  # the nearest that is good; of a list all
    complete: bool = True  # the work sufficed
    accept: Accept = is_good

    @classmethod
    def of_list(cls, path: str, values: Sequence[Value]) -> Search:
        """Return the search over listed values of a key, the nearest first."""
        return cls((path,), ways=[[{}, *({path: value} for value in values)]])

    @classmethod
    def of_key(
        cls,
        scene: Scene,
        path: str,
        edge: float | None = None,
        limits: tuple[float, float] = (0.0, math.inf),
        accept: Accept = is_good,
    ) -> Search | None:
        """Return the search over a key; None if it has no value.

        `edge`: end of the stable range nearest to the scene's value: the search begins there, and
          goes away from the scene.
        `limits`: no value beyond them is tried.
        """
        one = SearchRange.around(scene, path, 10.0**DECADES)
        if one is None:
            return None
        begin = one.own if edge is None else edge
        sides = (1.0, -1.0) if edge is None else (math.copysign(1.0, edge - one.own),)
        exponents = np.arange(round(DECADES * PER_DECADE) + 1) / PER_DECADE
        ways = []
        for side in sides:
            values = np.clip(begin * 10.0 ** (side * exponents), *limits).tolist()
            ways.append([one.own, *map(one.bought, values[edge is None :])])
        tried = [value for way in ways for value in way]
        rows: list[list[Values]] = [[{path: value} for value in way] for way in ways]
        return cls((path,), min(tried), max(tried), (one,), rows, accept=accept)

    def advance(self, trials: Trials, step: int) -> bool:
        """Try the next change of every way; return whether there are more of them to try."""
        for way in self.ways:
            if step + 1 >= len(way):
                continue
            good = self.first_good(trials, way[step], way[step + 1])
            if good is not None:
                self.found.append(good)
                if self.ranges:
                    return False
        return any(step + 2 < len(way) for way in self.ways)

    def first_good(self, trials: Trials, inner: Values, outer: Values) -> Trial | None:
        """Return the good trial nearest to `inner` from there to `outer`, as far as one is seen."""
        trial = trials.at(outer)
        best = trial if self.accept(trial) else None
        if not self.ranges:
            return best
        beyond = set() if best else _causes(trials.scene, trial)
        if inner == outer or beyond & _causes(trials.scene, trials.at(inner)):
            return best
        values = [inner, *self._between(inner, outer), outer]
        first, last = 0, len(values) - 1
        try:
            while last - first > 1:
                middle = (first + last) // 2
                trial = trials.at(values[middle])
                if self.accept(trial):
                    best, last, beyond = trial, middle, set()
                elif beyond & _causes(trials.scene, trial):
                    last = middle
                else:
                    first = middle
        except OutOfWorkError:
            self.complete = False
            if best is None:
                raise
        return best

    def _between(self, inner: Values, outer: Values) -> list[Values]:
        """Return what can be bought between two changes, in order."""
        moved = [one for one in self.ranges if inner[one.path] != outer[one.path]]
        ends = [(float(inner[one.path]), float(outer[one.path])) for one in moved]
        if len(self.ranges) == 1:
            (one,), ((start, end),) = moved, ends
            values = values_between(min(start, end), max(start, end), one.series)
            rows = [{one.path: value} for value in values[:: 1 if start < end else -1].tolist()]
        else:
            shares = np.linspace(0.0, 1.0, LINE)[1:-1].tolist()
            rows = [
                inner
                | {
                    one.path: one.bought(start * (end / start) ** share)
                    for one, (start, end) in zip(moved, ends, strict=True)
                }
                for share in shares
            ]
        return [row for row in rows if row not in (inner, outer)]


def walk(trials: Trials, searches: Iterable[Search]) -> None:
    """Search over all keys together, outwards from the scene, until each has found a good trial.

    A search that the work of the trials cuts is not `complete`.
    """
    open_searches, step = [each for each in searches if not each.found], 0
    try:
        while open_searches:
            for search in tuple(open_searches):
                if not search.advance(trials, step):
                    open_searches.remove(search)
            step += 1
    except OutOfWorkError:
        for search in open_searches:
            search.complete = False


def search_pair(trials: Trials, paths: tuple[str, str]) -> Search | None:
    """Return the search over two keys together; None where a key has no value.

    A simplex goes from the trial that is nearest to a pass to where the checks pass; then the line
    from the scene to there is halved.
    """
    found = [SearchRange.around(trials.scene, path, 10.0**PAIR_DECADES) for path in paths]
    ranges = tuple(one for one in found if one is not None)
    if len(ranges) < len(paths):
        return None
    search = Search(paths, ranges=ranges)
    own: Values = {one.path: one.own for one in ranges}

    def missed(values: Values) -> float:
        return missed_by(trials.scene, trials.at(values))

    try:
        known = [own, *(t.values for t in trials.tried if t.values.keys() <= own.keys())]
        start = own | min(known, key=missed)
        best = descend(missed, ranges, start, [SPACING * math.log(10.0)] * 2, 0.0)
        good = search.first_good(trials, own, best) if trials.at(best).good else None
        search.found = [] if good is None else [good]
    except OutOfWorkError:
        search.complete = False
    return search


class _EnoughError(Exception):
    """The objective is as small as it need be."""


def descend(
    objective: Callable[[Values], float],
    ranges: Sequence[SearchRange],
    start: Values,
    spacings: Sequence[float],
    enough: float = -math.inf,
) -> Values:
    """Return the values with the least objective that a simplex finds from a start.

    `spacings`: from the start to the first places, of each key, natural logarithm.
    `enough`: the search ends at an objective that is not above it.
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
        if value <= enough:
            raise _EnoughError
        return value

    begin = np.log([float(start[one.path]) for one in ranges])
    simplex = np.vstack([begin, begin + np.diag(spacings)])
    options: Any = {"initial_simplex": simplex, "maxfev": EVALUATIONS}
    options |= {"xatol": 1e-3, "fatol": 1e-4}
    with suppress(_EnoughError):
        minimize(at, begin.tolist(), method="Nelder-Mead", options=options)
    return best[1]


def missed_by(scene: Scene, trial: Trial) -> float:
    """Return how far a trial is from a pass: 0 for a good one.

    Each check that fails by itself counts the logarithm of its value over its limit.
    """
    missed = 0.0
    for name, below in sorted(_causes(scene, trial)):
        check = trial.record.check(name)
        limit = None if check is None else check.expected or check.tolerance
        limit = getattr(scene.checks, name).min if below else limit
        value, far = trial.reading(name), FAR
        if value and limit and trial.record.stable:
            far = min(abs(math.log(abs(value / limit))), FAR)
        missed += LEAST_MISS + far
    return missed


def _causes(scene: Scene, trial: Trial) -> set[tuple[str, bool]]:
    """Return what does not pass, and whether a time is below its `min`; empty if all is good."""

    def is_below(name: str) -> bool:
        least = getattr(getattr(scene.checks, name, None), "min", None)
        value = trial.reading(name)
        return least is not None and value is not None and value < least

    refused = {("parts", False)} if trial.refused else set()
    causes = set(trial.left) - {*following(trial.record.checks)}
    return refused | {(name, is_below(name)) for name in causes}
