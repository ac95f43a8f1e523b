"""Parts of an error budget as the differences of solutions that follow each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError

Predict = Callable[[], Floats | None]


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """One part: how far it moves the outputs, and the comparison that gives it.

    Attributes
    ----------
    value : float or None
        Largest deviation of any channel, V; None if it cannot be known.
    bound : float or None
        Proven bound on the value, V, where there is one.
    channels : tuple of float
        Signed deviation of every channel, V; empty for a part that has no sign or is not known.
    predicted : tuple of float
        The same from first-order sensitivities, where they were computed.
    """

    name: str
    value: float | None
    how: str
    bound: float | None = None
    channels: tuple[float, ...] = ()
    predicted: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """The parts, and the whole difference that they add up to.

    Attributes
    ----------
    total : ErrorPart or None
        End of the record less true stress, or less the optimum where the stress is not known; None
        for a verification without details.
    solves : int
        Solutions that only the budget needed.
    """

    parts: tuple[ErrorPart, ...] = ()
    total: ErrorPart | None = None
    solves: int = 0

    def __iter__(self) -> Iterator[ErrorPart]:
        """Return an iterator over the parts."""
        return iter(self.parts)

    @property
    def summed(self) -> tuple[float, ...]:
        """Sum of the signed parts of every channel, V."""
        signed = [part.channels for part in self.parts if part.channels]
        return tuple(map(math.fsum, zip(*signed, strict=True)))


class ErrorChain:
    """Solutions in the order in which a board moves away from the true stress.

    Attributes
    ----------
    first, last : ndarray (N,) or None
        The first and the latest known solution, V.
    parts : list of ErrorPart
        One for each step of the chain.
    solves : int
        Solutions that `solve` computed.
    """

    def __init__(self, first: Floats | None) -> None:
        self.first = self.last = first
        self.parts: list[ErrorPart] = []
        self.solves = 0

    def link(
        self,
        name: str,
        how: str,
        u: Floats,
        *,
        bound: float | None = None,
        predicted: Floats | None = None,
    ) -> None:
        """Add the part between the last solution and `u` (N,), V; unknown without a last one."""
        before, self.last = self.last, u
        if before is None:
            self.first = u
            self.parts.append(ErrorPart(name, None, how))
            return
        part = difference(name, how, before, u)
        forecast = () if predicted is None else tuple(predicted.tolist())
        self.parts.append(ErrorPart(name, part.value, how, bound, part.channels, forecast))

    def solve(
        self, name: str, how: str, find: Callable[[], Floats], predict: Predict = lambda: None
    ) -> None:
        """Add the part up to the solution of `find`; if that fails, the next part contains it."""
        self.solves += 1
        try:
            u, predicted = find(), predict()
        except EngineError as error:
            self.parts.append(ErrorPart(name, None, f"{how}: {error}"))
            return
        self.solves += predicted is not None
        self.link(name, how, u, predicted=predicted)


def difference(name: str, how: str, before: Floats, after: Floats) -> ErrorPart:
    """Return the part between two solutions (N,), V."""
    apart = after - before
    largest = float(np.max(np.abs(apart), initial=0.0))
    return ErrorPart(name, largest, how, None, tuple(apart.tolist()))
