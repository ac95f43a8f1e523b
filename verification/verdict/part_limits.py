"""The check that the parts can do what the small-signal solution asks of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from taction.netlist_gen.analysis import Transient
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import Initial, LinearBoard
from taction.verification.verdict.headroom import FULL, Load, headroom

NAME = "headroom"


@dataclass(frozen=True, slots=True)
class PartLoads:
    """The loads of the op-amps of a board.

    Attributes
    ----------
    loads : tuple of Load
        The largest share of a limit first; empty for a board of parts without limits, and for an
        unstable board, whose loads have no bound.
    unknown : str
        Why the loads are not known, or empty.
    unit_voltage : float or None
        U0 of a board whose loads are proportional to U0, V; else None.
    simulated : tuple of Load
        The loads of the small-signal board whose limits the simulated op-amps have.
    """

    loads: tuple[Load, ...] = ()
    unknown: str = ""
    unit_voltage: float | None = None
    simulated: tuple[Load, ...] = ()

    @classmethod
    def of(
        cls, board: LinearBoard, *, initial: Initial = "zero", transient: Transient | None = None
    ) -> PartLoads:
        """Find the loads of a stable board; parameters as `headroom`."""
        circuit = board.circuit
        if not any(model.is_limited for model in circuit.models.values()):
            return NOT_LIMITED
        volts = circuit.value("U0") if circuit.is_linear else None
        try:
            return cls(headroom(board, initial=initial, transient=transient), "", volts)
        except EngineError as error:
            return cls((), f"the loads of the op-amps are not known: {error}", volts)

    @property
    def worst(self) -> tuple[Load, ...]:
        """The largest load of each quantity, and all others above `FULL` of their limit."""
        first = {load.quantity: load for load in reversed(self.loads)}
        return tuple(x for x in self.loads if x.is_above or first[x.quantity] is x)

    @property
    def impossible(self) -> tuple[Load, ...]:
        """The loads that are above their limit at rest, the largest first."""
        above = (load for load in self.loads if load.rest > load.limit + load.error)
        return tuple(sorted(above, key=lambda load: -load.rest / load.limit))

    @property
    def largest_unit_voltage(self) -> float | None:
        """The largest U0 with which no part limits the board, V, two digits; None if unknown."""
        if self.unit_voltage is None or not self.loads:
            return None
        worst = self.loads[0]
        most = FULL * self.unit_voltage / (worst.share + worst.error / worst.limit)
        if not most > 0.0:  # the error of the load has no bound
            return None
        digit = 10.0 ** (math.floor(math.log10(most)) - 1)
        return digit * math.floor(most / digit)  # rounded down

    @property
    def remedy(self) -> str:
        """The unit voltage with which no part limits the board, or empty."""
        most = self.largest_unit_voltage
        if most is None:
            return ""
        return f"; unit_voltage = {show(most, 'V', 2)} keeps every op-amp below {FULL:.0%}"


NOT_LIMITED = PartLoads()


def amount(load: Load, value: float) -> str:
    """Return a value of a load with its unit: ``"1.6 V/us"``."""
    return show(value, load.unit, 3)


def describe(load: Load) -> str:
    """Return what a part has to do, and its limit."""
    when = " at rest" if math.isinf(load.at) else f" at {show(load.at, 's', 3)}"
    return (
        f"the output {load.quantity} of op-amp {load.part} reaches {amount(load, load.peak)}{when};"
        f" the limit is {amount(load, load.limit)}"
    )
