"""Ranges of the keys that a tuning may change."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from taction.netlist_gen.scene.keys import find_key, own_value, read_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError

AT_EDGE = 0.02  # of the logarithmic range: a value so close to an end is at its edge


@dataclass(frozen=True, slots=True)
class Range:
    """The range of one key."""

    path: str
    own: float  # the scene's value
    low: float
    high: float
    unit: str

    def edge_of(self, value: float) -> float | None:
        """Return the end of the range at which `value` lies, or None."""
        close = (self.high / self.low) ** AT_EDGE
        if value <= self.low * close:
            return self.low
        return self.high if value >= self.high / close else None


def parse_ranges(scene: Scene, keys: Iterable[str], reach: float, most: int) -> tuple[Range, ...]:
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


def _range(scene: Scene, path: str, body: str, reach: float) -> Range:
    if not path.startswith("design."):
        text = "only the design can be tuned, such as gain, capacitance or unit_conductance"
        raise InputError("--over", Complaint(path, "", text))
    key = find_key(scene, path)
    own = own_value(scene, key) if key.kind == "real" else None
    if own is None or not 0.0 < own < math.inf:
        text = "the scene has no value above zero of this key, from which the search could start"
        raise InputError("--over", Complaint(path, repr(own), text))
    if not body:
        return Range(path, own, own / reach, own * reach, key.unit)
    low, colon, high = body.partition(":")
    least, most = (float(read_value(key, end)) for end in (low, high if colon else low))
    if not 0.0 < least < most:
        swapped = "; are the two swapped?" if least > most > 0.0 else ""
        text = f"expected a range above zero, LOW below HIGH: {path}=LOW:HIGH{swapped}"
        raise InputError("--over", Complaint(path, repr(body), text))
    return Range(path, own, least, most, key.unit)
