"""Numbers of SPICE."""

from __future__ import annotations

import math
import re

SUFFIXES = {
    "meg": 1e6, "mil": 25.4e-6, "t": 1e12, "g": 1e9, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9,
    "p": 1e-12, "f": 1e-15,
}  # fmt: skip
_NUMBER = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?)([a-z]*)")


def number(text: str) -> float:
    """Return a SPICE number: ``M`` is milli, ``MEG`` mega, further letters are a unit.

    Examples
    --------
    >>> number("2.2k"), number("10meg"), number("3pf")
    (2200.0, 10000000.0, 3e-12)
    """
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a number")
    value = float(match[1])
    for suffix, scale in SUFFIXES.items():
        if match[2].startswith(suffix):
            value *= scale
            break
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value
