"""By what factor C may shrink, or the gain grow, before a pole leaves the left half plane."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.board.circuit import Circuit
from netlist_gen.quantities import show
from verification.engines.statespace.equations.stamps import stamp
from verification.engines.statespace.linearised.board import LinearBoard
from verification.small_signal.poles import Poles, poles

REACH = 100.0  # the largest factor that is looked at
PER_DECADE = 12  # points of the scan; an unstable window narrower than one of them is not seen
CLOSE = 1e-6  # relative error of a crossing


@dataclass(frozen=True, slots=True)
class Margin:
    """A stability margin in C or in the gain.

    Attributes
    ----------
    factor : float
        The change, always above 1, at which a pole first crosses; `reach` if none does up to
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


def capacitance_margin(
    circuit: Circuit | LinearBoard, reach: float = REACH, found: Poles | None = None
) -> Margin:
    """Scan C downwards from the board's own and refine the first crossing to 1e-6.

    Parameters
    ----------
    reach : float
        The largest factor that is looked at; less is cheaper where only a limit is of interest.
    found : Poles, optional
        Of the board as it is, where they are at hand already.

    Raises
    ------
    EngineError
        As `verification.small_signal.poles.poles`.

    Notes
    -----
    Costs 12 pole searches a decade up to the crossing, and about 8 for the crossing itself.
    """
    board = LinearBoard.of(circuit)
    circuit, whole = board.circuit, board.descriptor
    own = circuit.scalings.capacitance
    half = stamp(with_capacitance(circuit, 0.5 * own))
    # The mass matrix is linear in C, and the equilibrium does not depend on it.
    share = 2.0 * (whole.mass.values - half.mass.values)
    rest = board.equilibrium if whole.devices.count else None

    def growth(by: float) -> float:
        if by == 1.0 and found is not None:
            return found.rightmost.real
        values = whole.mass.values - (1.0 - 1.0 / by) * share
        shrunk = replace(whole, mass=replace(whole.mass, values=values))
        return poles(LinearBoard(circuit, shrunk, rest)).rightmost.real

    factor = _first_crossing(growth, reach)
    text = f"C may shrink by {factor:.4g}, to {show(own / (factor or 1.0), 'F')}"
    return Margin(factor, _words(factor, reach, text, f"C/{reach:g}"))


def gain_margin(circuit: Circuit) -> Margin:
    """Scan the gain s upwards from the board's own and refine the first crossing to 1e-6.

    R keeps its value, so lambda falls as s grows.

    Raises
    ------
    EngineError
        As `verification.small_signal.poles.poles`.

    Notes
    -----
    Costs as `capacitance_margin`.
    """
    own = circuit.scalings.gain
    factor = _first_crossing(lambda by: poles(with_gain(circuit, own * by)).rightmost.real, REACH)
    text = f"the gain may grow by {factor:.4g}, to {show(own * factor, 'ohm')}"
    return Margin(factor, _words(factor, REACH, text, f"{REACH:g} times the gain"))


def _words(factor: float, reach: float, crossing: str, last: str) -> str:
    if factor == 0.0:
        return "not stable as it is"
    return f"no crossing up to {last}" if factor == reach else crossing


def _first_crossing(growth: Callable[[float], float], reach: float) -> float:
    """Return the least factor above 1 at which a board ceases to be stable (see `Margin`).

    `growth` gives the rightmost pole's real part, 1/s, by the factor.
    """
    growth = functools.cache(growth)  # the search for the root asks again for both ends
    if not growth(1.0) < 0.0:
        return 0.0
    factors = np.geomspace(1.0, reach, 1 + math.ceil(PER_DECADE * math.log10(reach)))
    for low, high in itertools.pairwise(factors.tolist()):
        if not growth(high) < 0.0:
            from scipy.optimize import brentq

            root = brentq(growth, low, high, xtol=0.1 * CLOSE, rtol=0.4 * CLOSE)
            return float(root / (1.0 + 0.5 * CLOSE))  # on the stable side
    return reach
