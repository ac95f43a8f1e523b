"""True readings of a board, as stored beside the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class TrueValues:
    """The true readings of a case's board.

    Attributes
    ----------
    amplitude : float
        Step amplitude A, V.
    rightmost : tuple of float
        Real and imaginary part of the rightmost pole, 1/s.
    steady_state : float
        Largest distance of the equilibrium from the reference solution, fraction of A.
    channels : tuple of dict
        `READINGS` of every channel by name, and `final`, in s, fractions of A and V; a reading
        that the channel does not have is missing.
    error : float
        Error of the numbers: relative for times, of A for the others.
    by : str
        How the numbers were computed.
    arrives : bool
        False where the equilibrium is stable, but the transient leaves every bound.
    readable : bool
        False where the board rings for so many periods that times and peaks were not computed.
    margin : float or None
        The least factor by which C shrinks until the board oscillates; None if not computed.
    """

    amplitude: float
    rightmost: tuple[float, float]
    steady_state: float
    channels: tuple[Mapping[str, float], ...]
    error: float
    by: str
    arrives: bool = True
    readable: bool = True
    margin: float | None = None

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> TrueValues:
        """Return the values of a JSON record."""
        fixed = {"rightmost": tuple(record["rightmost"]), "channels": tuple(record["channels"])}
        return cls(**{**record, **fixed})

    def record(self) -> dict[str, Any]:
        """Return the values as a JSON record."""
        return asdict(self)

    @property
    def settles(self) -> bool:
        """Whether every channel has a settling time."""
        return all("settling_time" in channel for channel in self.channels)

    def largest(self, reading: str) -> float | None:
        """Return the largest of a reading over the channels; None if no channel has it."""
        values = [channel[reading] for channel in self.channels if reading in channel]
        return max(values, default=None)
