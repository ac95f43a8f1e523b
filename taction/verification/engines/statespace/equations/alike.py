"""Put what is of one kind together."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TypeVar

Key = TypeVar("Key")


def of_one_kind(kinds: Mapping[Key, Hashable]) -> list[list[Key]]:
    """Return the keys of each kind, in their order.

    Examples
    --------
    >>> of_one_kind({"a": 1, "b": 2, "c": 1})
    [['a', 'c'], ['b']]
    """
    groups: dict[Hashable, list[Key]] = {}
    for key, kind in kinds.items():
        groups.setdefault(kind, []).append(key)
    return list(groups.values())
