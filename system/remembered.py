"""Values that equal keys share, such as what several boards of a study have in common."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")
MOST = 64


def remembered(known: dict[K, V], key: K, make: Callable[[], V], most: int = MOST) -> V:
    """Return the value of `key` in `known`, made by `make` if it is not there.

    The oldest values are forgotten when there are more than `most`.

    Examples
    --------
    >>> known: dict[str, int] = {}
    >>> remembered(known, "one", lambda: 1), remembered(known, "one", lambda: 2), known
    (1, 1, {'one': 1})
    """
    if key in known:
        return known[key]
    made = make()
    for old in list(known)[: len(known) - most + 1]:
        known.pop(old, None)
    known[key] = made
    return made
