"""By what factor C may shrink before a pole crosses into the right half plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.circuit import Circuit
from netlist_gen.quantities import show
from verification.stability import poles

REACH = 100.0  # the largest factor that is looked at
PER_DECADE = 12  # points of the scan; an unstable window narrower than one of them is not seen


@dataclass(frozen=True, slots=True)
class Margin:
    """A stability margin in C.

    Attributes
    ----------
    factor : float
        C over the largest smaller C at which a pole crosses; `REACH` if none does down to there.
    text : str
        The same in words.
    """

    factor: float
    text: str


def with_capacitance(circuit: Circuit, farads: float) -> Circuit:
    """Return `circuit` with another C at every signal node."""
    signal = {f"c_{node.removeprefix('v_')}" for node in circuit.signal_nodes}
    capacitors = tuple(
        replace(part, farads=farads) if part.name in signal else part for part in circuit.capacitors
    )
    scalings = replace(circuit.scalings, capacitance=farads)
    return replace(circuit, capacitors=capacitors, scalings=scalings)


def capacitance_margin(circuit: Circuit) -> Margin:
    """Scan C downwards from the board's own and refine the first crossing to 1e-6.

    Raises
    ------
    EngineError
        As `verification.stability.poles`.

    Notes
    -----
    Costs about 45 pole searches at the most.
    """
    own = circuit.scalings.capacitance

    def stable(factor: float) -> bool:
        return poles(with_capacitance(circuit, own / factor)).stable

    if not stable(1.0):
        return Margin(0.0, "not stable as it is")
    factors = np.geomspace(1.0, REACH, 1 + int(PER_DECADE * np.log10(REACH)))
    for low, high in zip(factors[:-1].tolist(), factors[1:].tolist(), strict=True):
        if not stable(high):
            factor = _bisect(stable, low, high)
            where = show(own / factor, "F")
            return Margin(factor, f"C may shrink by {factor:.4g}, to {where}")
    return Margin(REACH, f"no crossing down to C/{REACH:g}")


def _bisect(stable: Callable[[float], bool], low: float, high: float) -> float:
    while high - low > 1e-6 * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
