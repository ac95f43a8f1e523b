"""Linear parts between any two nodes, which a deck has and no topology: coils and sources.

With resistors and capacitors they are every linear card of SPICE: L, K, V, I, E, F, G, H, and what
transistors have besides (`ChargeByVoltage`). The state
of a deck has no strain: its sources are constant, or step at t = 0 (`Source`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from taction.netlist_gen.board.parts import Branch


@dataclass(frozen=True, slots=True)
class Coil(Branch):
    """An inductor of `value` H."""

    letter: ClassVar[str] = "L"


@dataclass(frozen=True, slots=True)
class BranchCoupling(Branch):
    """Coils that share flux: `a` and `b` are their cards, `value` is k, from -1 to 1."""

    letter: ClassVar[str] = "K"

    @property
    def nodes(self) -> tuple[str, ...]:
        """It has none."""
        return ()


@dataclass(frozen=True, slots=True)
class Source(Branch):
    """A source of `value` from t = 0, and of `before` until then."""

    before: float

    @property
    def step(self) -> float:
        """What is switched on at t = 0."""
        return self.value - self.before


@dataclass(frozen=True, slots=True)
class VoltageBetween(Source):
    """``V(a) - V(b)`` in V."""

    letter: ClassVar[str] = "V"


@dataclass(frozen=True, slots=True)
class CurrentBetween(Source):
    """A current from `a` through the source to `b`, A."""

    letter: ClassVar[str] = "I"


@dataclass(frozen=True, slots=True)
class ByVoltage(Branch):
    """A source of `value` times the voltage between two nodes, `control`."""

    control: tuple[str, str]

    @property
    def nodes(self) -> tuple[str, ...]:
        """Both ends, then the nodes that control it."""
        return self.a, self.b, *self.control


@dataclass(frozen=True, slots=True)
class VoltageByVoltage(ByVoltage):
    """A voltage, V/V."""

    letter: ClassVar[str] = "E"


@dataclass(frozen=True, slots=True)
class CurrentByVoltage(ByVoltage):
    """A current from `a` through the source to `b`, A/V."""

    letter: ClassVar[str] = "G"


@dataclass(frozen=True, slots=True)
class ChargeByVoltage(ByVoltage):
    """A charge that flows from `a` to `b` as a voltage elsewhere changes, F; of transistors."""

    letter: ClassVar[str] = "Y"


@dataclass(frozen=True, slots=True)
class ByCurrent(Branch):
    """A source of `value` times the current through a voltage source, whose card `control` is."""

    control: str


@dataclass(frozen=True, slots=True)
class CurrentByCurrent(ByCurrent):
    """A current from `a` through the source to `b`, A/A."""

    letter: ClassVar[str] = "F"


@dataclass(frozen=True, slots=True)
class VoltageByCurrent(ByCurrent):
    """A voltage, V/A."""

    letter: ClassVar[str] = "H"
