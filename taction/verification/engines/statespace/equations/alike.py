"""Solve the equations of many boards at once: those together that take the same steps.

A function of a stack has arrays with the boards along the first axis. Where a number decides what
it does next, it asks `agreed`; a stack whose boards do not agree is solved again in parts. So each
board takes the steps that it takes alone, and has the same digits.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from taction.system.array_types import Bools, Ints
from taction.system.errors import EngineError

System = TypeVar("System")
Found = TypeVar("Found")
Key = TypeVar("Key")


class Unlike(Exception):  # noqa: N818 - no error: the stack is solved in parts
    """The boards of a stack take different steps; boards of one number in `kinds` (B,) agree."""

    def __init__(self, kinds: Ints) -> None:
        super().__init__("the boards of a stack take different steps")
        self.kinds = kinds


def agreed(decisions: Bools | np.bool_) -> Bools:
    """Return what all boards of a stack decide: one row of `decisions` (B, ...).

    Unlike: boards decide differently.

    Examples
    --------
    >>> bool(agreed(np.array([True, True])))
    True
    """
    every = np.asarray(decisions)
    first = every[0]
    if len(every) > 1 and (every != first).any():
        flat = every.reshape(len(every), -1)
        raise Unlike(np.unique(flat, axis=0, return_inverse=True)[1].reshape(-1))
    return np.asarray(first)


def alone(count: int) -> None:
    """Go on with a single board only.

    Unlike: the stack has more than one board.
    """
    if count > 1:
        raise Unlike(np.arange(count))


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


def in_groups(
    systems: Sequence[System],
    are_alike: Callable[[System, System], bool],
    solve: Callable[[Sequence[System]], Sequence[Found]],
) -> list[Found | EngineError]:
    """Return what `solve` finds for each system, in stacks of those that are alike."""
    groups = list[list[int]]()
    for k, system in enumerate(systems):
        for group in groups:
            if are_alike(systems[group[0]], system):
                group.append(k)
                break
        else:
            groups.append([k])
    found: dict[int, Found | EngineError] = {}
    for group in groups:
        found |= zip(group, solve_alike([systems[k] for k in group], solve), strict=True)
    return [found[k] for k in range(len(systems))]


def solve_alike(
    systems: Sequence[System], solve: Callable[[Sequence[System]], Sequence[Found]]
) -> list[Found | EngineError]:
    """Return what `solve` finds for each system, or why it finds nothing.

    `solve` gets a stack; if it raises `Unlike`, it gets those that agree.
    """
    try:
        return list(solve(systems))
    except EngineError as error:
        return [error for _ in systems]
    except Unlike as unlike:
        kinds = unlike.kinds
    found: dict[int, Found | EngineError] = {}
    for kind in np.unique(kinds).tolist():
        places = np.flatnonzero(kinds == kind).tolist()
        found |= zip(places, solve_alike([systems[k] for k in places], solve), strict=True)
    return [found[k] for k in range(len(systems))]
