"""Searches for the change nearest to the scene, of one key or of two, that is good.

Outwards from the scene's value in steps of a fixed ratio, on both sides in turns; then the interval
between the first value that passes and its neighbour is halved on the values that can be bought.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from taction.netlist_gen.scene.keys import Value
from taction.system.errors import InputError
from taction.verification.design.ranges import SearchRange
from taction.verification.design.trials import OutOfWorkError, Trial, Trials

PER_DECADE = 6  # values of one key; a window narrower than that can be missed
DECADES = 2.0  # on both sides of the scene's value
PAIR_PER_DECADE, PAIR_DECADES = 4, 1.5  # of two keys together
HALVINGS = 7  # of an interval between two failures of different checks, or of the way to a pair

Limits = tuple[float, float]
Place = tuple[float, float]  # steps of one key, or of two
At = Callable[[Sequence[float]], dict[str, Value]]  # the change at a place


@dataclass(frozen=True, slots=True)
class Searched:
    """The search over one key or over two.

    Attributes
    ----------
    paths : tuple of str
        The keys.
    found : Trial or None
        The nearest good trial.
    least, most : float or None
        Ends of the values that were tried, of one key with a range.
    complete : bool
        Whether the work sufficed.
    """

    DOCUMENT = ("keys = paths", "from = least", "to = most")

    paths: tuple[str, ...]
    found: Trial | None
    least: float | None = None
    most: float | None = None
    complete: bool = True


def search_range(
    trials: Trials, path: str, edge: float | None = None, limits: Limits = (0.0, math.inf)
) -> Searched | None:
    """Return the nearest value of a key whose trial is good; None if the key has no value.

    Parameters
    ----------
    edge : float, optional
        End of the stable range nearest to the scene's value: the search begins there.
    limits : pair of float
        No value beyond them is tried.

    Notes
    -----
    Costs at most 24 trials and about 9 for the halving.
    """
    one = SearchRange.around(trials.scene, path, 10.0**DECADES)
    if one is None:
        return None
    start, tried = one.own if edge is None else edge, [one.own]

    def at(place: Sequence[float]) -> dict[str, Value]:
        return {path: one.bought(math.exp(place[0]))}

    found: Trial | None = None
    try:
        steps = [
            (before, min(max(value, limits[0]), limits[1]))
            for before, value in _outwards(start, one.own, edge)
            if limits[0] <= before <= limits[1]
        ]
        ways = [((math.log(before), 0.0), (math.log(value), 0.0)) for before, value in steps]
        for (before, value), ends in zip(steps, ways, strict=True):
            tried.append(value)
            place = _window(trials, at, ends)
            if place is not None:
                found = trials.at(at(place))
                values = one.between(before, float(found.values[path]))
                found = _first(trials, path, values) or found
                break
    except OutOfWorkError:
        return Searched((path,), found, min(tried), max(tried), complete=False)
    return Searched((path,), found, min(tried), max(tried))


def _outwards(start: float, own: float, edge: float | None) -> Iterator[tuple[float, float]]:
    """Yield neighbouring values, the first nearer to `start`; beyond an edge only away from own."""
    ratio = 10.0 ** (1.0 / PER_DECADE)
    sides = (1.0, -1.0) if edge is None else (math.copysign(1.0, edge - own),)
    for step in range(round(DECADES * PER_DECADE)):
        for side in sides:
            yield start * ratio ** (side * step), start * ratio ** (side * (step + 1))


def _first(trials: Trials, path: str, values: Sequence[float]) -> Trial | None:
    """Return the trial of the first good one of ordered values, found by halving."""
    first, last, best = 0, len(values) - 1, None
    while first <= last:
        middle = (first + last) // 2
        trial = trials.at({path: values[middle]})
        if trial.good:
            best, last = trial, middle - 1
        else:
            first = middle + 1
    return best


def search_list(trials: Trials, path: str, values: Sequence[Value]) -> tuple[Searched, list[Trial]]:
    """Return the first good value of a list, the nearest first, and all good ones."""
    good: list[Trial] = []
    try:
        for value in values:
            trial = trials.at({path: value})
            if trial.good:
                good.append(trial)
    except OutOfWorkError:
        return Searched((path,), next(iter(good), None), complete=False), good
    return Searched((path,), next(iter(good), None)), good


def search_pair(trials: Trials, paths: tuple[str, ...]) -> Searched:
    """Return the pair of values of two keys, nearest by their ratios, whose trial is good.

    Notes
    -----
    Costs at most 168 trials, and up to `HALVINGS` for each two neighbours that fail in different
    checks; an unstable board costs its poles alone.
    """
    ranges = [SearchRange.around(trials.scene, path, 10.0**PAIR_DECADES) for path in paths]
    known = [one for one in ranges if one is not None]
    if len(known) < len(paths):
        return Searched(paths, None)

    def at(steps: Sequence[float]) -> dict[str, Value]:
        ratios = (10.0 ** (step / PAIR_PER_DECADE) for step in steps)
        return {one.path: one.bought(one.own * by) for one, by in zip(known, ratios, strict=True)}

    reach = range(-round(PAIR_DECADES * PAIR_PER_DECADE), round(PAIR_DECADES * PAIR_PER_DECADE) + 1)
    places = [(i, j) for i in reach for j in reach if i and j]
    try:
        places.sort(key=lambda p: p[0] ** 2 + p[1] ** 2)
        ways = [((i - math.copysign(1, i), j), (i, j)) for i, j in places]
        for ends in ways:
            found = _window(trials, at, ends)
            if found is not None:
                return Searched(paths, _nearer(trials, at, found))
    except (OutOfWorkError, InputError):
        return Searched(paths, None, complete=False)
    return Searched(paths, None)


def _window(
    trials: Trials,
    at: At,
    ends: tuple[Place, Place],
) -> Place | None:
    """Return the outer end if its trial is good, or a place of a window between the two.

    Where the two fail in different checks, some value between them may pass.
    """
    inner, outer = ends
    trial = trials.at(at(outer))
    if trial.good:
        return outer
    causes, others = _causes(trials, trials.at(at(inner))), _causes(trials, trial)
    for _ in range(HALVINGS):
        if not causes or not others or causes & others:
            return None
        middle = (0.5 * (inner[0] + outer[0]), 0.5 * (inner[1] + outer[1]))
        trial = trials.at(at(middle))
        if trial.good:
            return middle
        left = _causes(trials, trial)
        if left & causes:
            inner, causes = middle, left
        else:
            outer, others = middle, left
    return None


def _causes(trials: Trials, trial: Trial) -> set[tuple[str, bool]]:
    """Return the checks that do not pass, and whether a time is below its `min`.

    Between a design that is too fast and one that is too slow another one may pass.
    """

    def is_below(name: str) -> bool:
        least = getattr(getattr(trials.scene.checks, name, None), "min", None)
        value = trial.reading(name)
        return least is not None and value is not None and value < least

    return {(name, is_below(name)) for name in trial.left}


def _nearer(
    trials: Trials,
    at: At,
    place: Place,
) -> Trial:
    """Return the good trial nearest to the scene on the straight line to `place`."""
    low, high, best = 0.0, 1.0, trials.at(at(place))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        trial = trials.at(at([middle * step for step in place]))
        if trial.good:
            best, high = trial, middle
        else:
            low = middle
    return best
