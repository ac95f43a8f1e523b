"""By what factor C may shrink, or the gain grow, before a pole leaves the left half plane."""

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
    """A stability margin in C or in the gain.

    Attributes
    ----------
    factor : float
        The change, always above 1, at which a pole first crosses; `REACH` if none does up to
        there, 0 for a board that is not stable as it is.
    text : str
        The same in words.
    """

    factor: float
    text: str


def with_capacitance(circuit: Circuit, farads: float) -> Circuit:
    """Return `circuit` with another C; parts that differ from each other scale alike."""
    factor = farads / circuit.scalings.capacitance
    signal = {f"c_{node.removeprefix('v_')}" for node in circuit.signal_nodes}
    capacitors = tuple(
        replace(part, farads=part.farads * factor) if part.name in signal else part
        for part in circuit.capacitors
    )
    scalings = replace(circuit.scalings, capacitance=farads)
    return replace(circuit, capacitors=capacitors, scalings=scalings)


def with_gain(circuit: Circuit, ohms: float) -> Circuit:
    """Return `circuit` with another feedback resistor s at every constraint node, R as it is."""
    gains = {f"s_{node.removeprefix('w_')}" for node in circuit.constraint_nodes}
    resistors = tuple(
        replace(part, ohms=ohms) if part.name in gains else part for part in circuit.resistors
    )
    own = circuit.scalings
    scalings = replace(own, gain=ohms, lam=own.lam * own.gain / ohms)
    return replace(circuit, resistors=resistors, scalings=scalings)


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
    factor = _first_crossing(lambda by: with_capacitance(circuit, own / by))
    text = f"C may shrink by {factor:.4g}, to {show(own / (factor or 1.0), 'F')}"
    return Margin(factor, _WORDS.get(factor, text).format(last=f"C/{REACH:g}"))


def gain_margin(circuit: Circuit) -> Margin:
    """Scan the gain s upwards from the board's own and refine the first crossing to 1e-6.

    R keeps its value, so lambda falls as s grows.

    Raises
    ------
    EngineError
        As `verification.stability.poles`.

    Notes
    -----
    Costs about 45 pole searches at the most.
    """
    own = circuit.scalings.gain
    factor = _first_crossing(lambda by: with_gain(circuit, own * by))
    text = f"the gain may grow by {factor:.4g}, to {show(own * factor, 'ohm')}"
    return Margin(factor, _WORDS.get(factor, text).format(last=f"{REACH:g} times the gain"))


_WORDS = {0.0: "not stable as it is", REACH: "no crossing up to {last}"}


def _first_crossing(board: Callable[[float], Circuit]) -> float:
    """Return the least factor above 1 at which `board` ceases to be stable (see `Margin`)."""

    def stable(factor: float) -> bool:
        return poles(board(factor)).stable

    if not stable(1.0):
        return 0.0
    factors = np.geomspace(1.0, REACH, 1 + int(PER_DECADE * np.log10(REACH)))
    for low, high in zip(factors[:-1].tolist(), factors[1:].tolist(), strict=True):
        if not stable(high):
            return _bisect(stable, low, high)
    return REACH


def _bisect(stable: Callable[[float], bool], low: float, high: float) -> float:
    while high - low > 1e-6 * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
