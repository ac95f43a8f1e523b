"""The change of one key, or of two, nearest to the scene's value, with which all checks pass.

Outwards from the scene's value in steps of a fixed ratio, on both sides in turns; then the interval
between the first value that passes and its neighbour is halved on the values that can be bought.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from taction.netlist_gen.board.buyable_values import buyable, series_of, values_between
from taction.netlist_gen.scene.keys import Value, find_key, own_value
from taction.system.errors import InputError
from taction.verification.design.trials import OutOfTimeError, Trial, Trials

PER_DECADE = 6  # values of one key; a window narrower than that can be missed
DECADES = 2.0  # on both sides of the scene's value
PAIR_PER_DECADE, PAIR_DECADES = 4, 1.5  # of two keys together
HALVINGS = 7  # of an interval between two failures of different checks, or of the way to a pair

Accepts = Callable[[Trial], bool]
Place = tuple[float, float]  # steps of one key, or of two


@dataclass(frozen=True, slots=True)
class Searched:
    """The search over one key or over two.

    Attributes
    ----------
    paths : tuple of str
        The keys.
    found : Trial or None
        The nearest trial that passes.
    least, most : float or None
        Ends of the values that were tried, of one key with a range.
    complete : bool
        Whether the time sufficed.
    """

    paths: tuple[str, ...]
    found: Trial | None
    least: float | None = None
    most: float | None = None
    complete: bool = True


def search_range(
    trials: Trials, path: str, accepts: Accepts, edge: float | None = None
) -> Searched | None:
    """Return the nearest value of a key whose trial is accepted; None if the key has no value.

    Parameters
    ----------
    edge : float, optional
        End of the stable range nearest to the scene's value: the search begins there.

    Notes
    -----
    Costs at most 24 trials and about 9 for the halving.
    """
    key = find_key(trials.scene, path)
    own = own_value(trials.scene, key)
    if own is None or not 0.0 < own < math.inf:
        return None
    start, tried = own if edge is None else edge, [own]

    found: Trial | None = None
    try:
        for before, value in _outwards(start, own, edge):
            tried.append(value)
            between = _Between(trials, path, accepts)
            found = between.first(before, value)
            if found is not None:
                found = between.nearest(before, float(found.changes[path])) or found
                break
    except OutOfTimeError:
        return Searched((path,), found, min(tried), max(tried), complete=False)
    return Searched((path,), found, min(tried), max(tried))


def _outwards(start: float, own: float, edge: float | None) -> Iterator[tuple[float, float]]:
    """Yield neighbouring values, the first nearer to `start`; beyond an edge only away from own."""
    ratio = 10.0 ** (1.0 / PER_DECADE)
    sides = (1.0, -1.0) if edge is None else (math.copysign(1.0, edge - own),)
    for step in range(round(DECADES * PER_DECADE)):
        for side in sides:
            yield start * ratio ** (side * step), start * ratio ** (side * (step + 1))


@dataclass(frozen=True, slots=True)
class _Between:
    """The search between two neighbouring values of a key."""

    trials: Trials
    path: str
    accepts: Accepts

    @property
    def series(self) -> str:
        return series_of(self.trials.scene.design, self.path)

    def first(self, before: float, value: float) -> Trial | None:
        """Return an accepted trial at `value`, or in a window between the two; None without one."""
        ends = ((math.log(before), 0.0), (math.log(value), 0.0))

        def values(place: Sequence[float]) -> dict[str, Value]:
            return {self.path: buyable(math.exp(place[0]), self.series)}

        found = _window(self.trials, values, ends, self.accepts)
        return None if found is None else self.trials.at(values(found))

    def nearest(self, before: float, value: float) -> Trial | None:
        """Return the accepted trial nearest to `before`, by halving on the values of the series."""
        values = values_between(min(before, value), max(before, value), self.series).tolist()
        if before > value:
            values.reverse()
        first, last, best = 0, len(values) - 1, None
        while first <= last:
            middle = (first + last) // 2
            trial = self.trials.at({self.path: values[middle]})
            if self.accepts(trial):
                best, last = trial, middle - 1
            else:
                first = middle + 1
        return best


def search_list(
    trials: Trials, path: str, values: Sequence[Value], accepts: Accepts
) -> tuple[Searched, list[Trial]]:
    """Return the first accepted value of a list, the nearest first, and all accepted ones."""
    accepted: list[Trial] = []
    try:
        for value in values:
            trial = trials.at({path: value})
            if accepts(trial):
                accepted.append(trial)
    except OutOfTimeError:
        return Searched((path,), next(iter(accepted), None), complete=False), accepted
    return Searched((path,), next(iter(accepted), None)), accepted


def search_pair(trials: Trials, paths: tuple[str, str], accepts: Accepts) -> Searched:
    """Return the pair of values of two keys, nearest by their ratios, whose trial is accepted.

    Notes
    -----
    Costs at most 168 trials, and up to `HALVINGS` for each two neighbours that fail in different
    checks; an unstable board costs its poles alone.
    """
    keys = [find_key(trials.scene, path) for path in paths]
    own = [own_value(trials.scene, key) for key in keys]
    if not all(value is not None and 0.0 < value < math.inf for value in own):
        return Searched(paths, None)
    origin = [float(value or 1.0) for value in own]
    series = [series_of(trials.scene.design, path) for path in paths]

    def at(steps: Sequence[float]) -> dict[str, Value]:
        ratios = (10.0 ** (step / PAIR_PER_DECADE) for step in steps)
        values = (buyable(o * r, s) for o, r, s in zip(origin, ratios, series, strict=True))
        return dict(zip(paths, values, strict=True))

    reach = range(-round(PAIR_DECADES * PAIR_PER_DECADE), round(PAIR_DECADES * PAIR_PER_DECADE) + 1)
    places = [(i, j) for i in reach for j in reach if i and j]
    try:
        for place in sorted(places, key=lambda p: p[0] ** 2 + p[1] ** 2):
            inner = (place[0] - math.copysign(1, place[0]), place[1])
            found = _window(trials, at, (inner, place), accepts)
            if found is not None:
                return Searched(paths, _nearer(trials, at, found, accepts))
    except (OutOfTimeError, InputError):
        return Searched(paths, None, complete=False)
    return Searched(paths, None)


def _window(
    trials: Trials,
    at: Callable[[Sequence[float]], dict[str, Value]],
    ends: tuple[Place, Place],
    accepts: Accepts,
) -> Place | None:
    """Return the outer end if its trial is accepted, or a place of a window between the two.

    Where the two fail in different checks, some value between them may pass.
    """
    inner, outer = ends
    trial = trials.at(at(outer))
    if accepts(trial):
        return outer
    causes, others = set(trials.at(at(inner)).left), set(trial.left)
    for _ in range(HALVINGS):
        if not causes or not others or causes & others:
            return None
        middle = (0.5 * (inner[0] + outer[0]), 0.5 * (inner[1] + outer[1]))
        trial = trials.at(at(middle))
        if accepts(trial):
            return middle
        left = set(trial.left)
        if left & causes:
            inner, causes = middle, left
        else:
            outer, others = middle, left
    return None


def _nearer(
    trials: Trials,
    at: Callable[[Sequence[float]], dict[str, Value]],
    place: Place,
    accepts: Accepts,
) -> Trial:
    """Return the accepted trial nearest to the scene on the straight line to `place`."""
    low, high, best = 0.0, 1.0, trials.at(at(place))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        trial = trials.at(at([middle * step for step in place]))
        if accepts(trial):
            best, high = trial, middle
        else:
            low = middle
    return best
