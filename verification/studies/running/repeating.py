"""Repeat a computation whose simulator was killed: that is no property of the point."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from taction.system.errors import Killed
from taction.system.own_folders import remove_own_folder

T = TypeVar("T")

RUNS = 3  # as often as a point is computed whose worker is killed


def repeated_if_killed(function: Callable[[], T]) -> T:
    """Return ``function()``; where a signal ended ngspice, the result of another call.

    Raises
    ------
    Killed
        A signal ended ngspice in each of `RUNS` calls, as where the memory is too small.
    """
    for _ in range(RUNS - 1):
        try:
            return function()
        except Killed as error:
            if error.folder is not None:  # nobody will be told of this reproducer
                remove_own_folder(error.folder)
    return function()
