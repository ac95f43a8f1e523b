"""True readings of a board, as stored beside the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class TrueValues:
    """The true readings of a case's board."""

    amplitude: float  # of the step, V
    rightmost: tuple[float, float]  # pole, 1/s
    steady_state: float  # largest distance of the equilibrium from the reference, of the step
    channels: tuple[Mapping[str, float], ...]  # the `READINGS` and `final` that exist
    error: float  # of the numbers: relative for times, of the step for the others
    by: str  # how the numbers were computed
    arrives: bool = True  # False: stable, but the transient leaves every bound
    readable: bool = True  # False: it rings for so many periods that readings were not computed
    margin: float | None = None  # factor by which C shrinks until the board oscillates, if known

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
