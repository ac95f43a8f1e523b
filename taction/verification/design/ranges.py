"""Ranges of keys: the values that a search for a better design may try."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.preferred_values import buyable, series_of, values_between
from taction.netlist_gen.scene.axes import rising_ends
from taction.netlist_gen.scene.keys import find_key, own_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError

AT_EDGE = 0.02  # of the logarithmic range: a value so close to an end is at its edge


@dataclass(frozen=True, slots=True)
class SearchRange:
    """The values of one key, above zero, that can be bought.

    Attributes
    ----------
    path, unit : str
        The key, and its SI unit.
    own : float
        The scene's value.
    low, high : float
        Ends of the range.
    series : str
        Of the values; ``"exact"`` for all numbers of three digits.
    """

    path: str
    unit: str
    own: float
    low: float
    high: float
    series: str

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

    def between(self, first: float, last: float) -> list[float]:
        """Return all values that can be bought from `first` to `last`."""
        values: list[float]
        values = values_between(min(first, last), max(first, last), self.series).tolist()
        return values if first < last else values[::-1]

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

    Raises
    ------
    InputError
        A key is unknown, not of the design, or has no value; a range is none; too many keys.

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
