"""Stability margins: the factor by which C can shrink, or the gain grow, on a stable board."""

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

REACH = 100.0  # the largest factor of the scan
PER_DECADE = 12  # points of the scan; the scan can miss a narrower unstable interval
CLOSE = 1e-6  # relative error of a crossing


@dataclass(frozen=True, slots=True)
class Margin:
    """A stability margin in C or in the gain.

    Attributes
    ----------
    factor : float
        The least factor, above 1, at which a pole crosses the imaginary axis; `reach` if no pole
        crosses up to `reach`, 0 for an unstable board.
    text : str
        The same in words.
    """

    factor: float
    text: str


def with_capacitance(circuit: Circuit, farads: float) -> Circuit:
    """Return `circuit` with another C; all signal-plane capacitors scale by one factor."""
    factor = farads / circuit.scalings.capacitance
    signal = {f"c_{node.removeprefix('v_')}" for node in circuit.signal_nodes}
    capacitors = tuple(
        replace(part, farads=part.farads * factor) if part.name in signal else part
        for part in circuit.capacitors
    )
    scalings = replace(circuit.scalings, capacitance=farads)
    return replace(circuit, capacitors=capacitors, scalings=scalings)


def with_gain(circuit: Circuit, ohms: float) -> Circuit:
    """Return `circuit` with another feedback resistor s at every constraint node, same R."""
    gains = {f"s_{node.removeprefix('w_')}" for node in circuit.constraint_nodes}
    resistors = tuple(
        replace(part, ohms=ohms) if part.name in gains else part for part in circuit.resistors
    )
    before = circuit.scalings
    scalings = replace(before, gain=ohms, lam=before.lam * before.gain / ohms)
    return replace(circuit, resistors=resistors, scalings=scalings)


def capacitance_margin(
    circuit: Circuit | LinearBoard, reach: float = REACH, found: Poles | None = None
) -> Margin:
    """Scan C downwards from the value of the board and refine the first crossing to 1e-6.

    Parameters
    ----------
    reach : float
        The largest factor of the scan; a smaller one costs less.
    found : Poles, optional
        Poles of the board, if they have been computed before.

    Raises
    ------
    EngineError
        As `verification.small_signal.poles.poles`.

    Notes
    -----
    The cost is 12 pole searches per decade up to the crossing, and about 8 for its refinement.
    """
    board = LinearBoard.of(circuit)
    circuit, equations = board.circuit, board.descriptor
    capacitance = circuit.scalings.capacitance
    half = stamp(with_capacitance(circuit, 0.5 * capacitance))
    # The mass matrix is linear in C, and the equilibrium does not depend on it.
    share = 2.0 * (equations.mass.values - half.mass.values)
    equilibrium = board.equilibrium if equations.devices.count else None

    def growth(by: float) -> float:
        if by == 1.0 and found is not None:
            return found.rightmost.real
        values = equations.mass.values - (1.0 - 1.0 / by) * share
        shrunk = replace(equations, mass=replace(equations.mass, values=values))
        return poles(LinearBoard(circuit, shrunk, equilibrium)).rightmost.real

    factor = _first_crossing(growth, reach)
    text = f"C can shrink by the factor {factor:.4g}, to {show(capacitance / (factor or 1.0), 'F')}"
    return Margin(factor, _words(factor, reach, text, f"C/{reach:g}"))


def gain_margin(circuit: Circuit) -> Margin:
    """Scan the gain s upwards from the value of the board and refine the first crossing to 1e-6.

    R keeps its value, so lambda falls as s grows.

    Raises
    ------
    EngineError
        As `verification.small_signal.poles.poles`.

    Notes
    -----
    The cost is that of `capacitance_margin`.
    """
    gain = circuit.scalings.gain
    factor = _first_crossing(lambda by: poles(with_gain(circuit, gain * by)).rightmost.real, REACH)
    text = f"the gain can grow by the factor {factor:.4g}, to {show(gain * factor, 'ohm')}"
    return Margin(factor, _words(factor, REACH, text, f"{REACH:g} times the gain"))


def _words(factor: float, reach: float, crossing: str, last: str) -> str:
    if factor == 0.0:
        return "the board is unstable"
    return f"no crossing up to {last}" if factor == reach else crossing


def _first_crossing(growth: Callable[[float], float], reach: float) -> float:
    """Return the least factor above 1 at which a board becomes unstable (see `Margin`).

    `growth` returns the real part of the rightmost pole, 1/s, at a factor.
    """
    growth = functools.cache(growth)  # the root search evaluates both ends again
    if not growth(1.0) < 0.0:
        return 0.0
    factors = np.geomspace(1.0, reach, 1 + math.ceil(PER_DECADE * math.log10(reach)))
    for low, high in itertools.pairwise(factors.tolist()):
        if not growth(high) < 0.0:
            from scipy.optimize import brentq

            root = brentq(growth, low, high, xtol=0.1 * CLOSE, rtol=0.4 * CLOSE)
            return float(root / (1.0 + 0.5 * CLOSE))  # on the stable side
    return reach
