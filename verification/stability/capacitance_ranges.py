"""The values of C at which a board is stable, from the loci of its capacitors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from taction.netlist_gen.board.circuit import Circuit
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.margin import signal_capacitors
from taction.verification.stability.parameter_loci import Loci, trace_loci
from taction.verification.stability.poles import Poles, poles
from taction.verification.stability.port_response import PortResponse

AROUND = 30.0  # the values from C / 30 to 30 C


@dataclass(frozen=True, slots=True)
class CapacitanceRanges:
    """Stable and unstable values of C, all signal-plane capacitors scaled together.

    Attributes
    ----------
    low, high : float
        The examined values, F.
    stable : tuple of pairs of float
        Ranges in which every pole is left of the imaginary axis, F, in increasing order.
    near : tuple of float
        Values at which a pole comes so close to the axis that rounding decides, F.
    """

    low: float
    high: float
    stable: tuple[tuple[float, float], ...]
    near: tuple[float, ...]


def capacitance_ranges(
    circuit: Circuit | LinearBoard, around: float = AROUND, found: Poles | None = None
) -> CapacitanceRanges:
    """Find the values of C, within a factor of `around` of the board's own, that are stable.

    Parameters
    ----------
    found : Poles, optional
        Poles of the board, if they have been computed before.

    Raises
    ------
    EngineError
        As `trace_loci` and `taction.verification.stability.poles.poles`.

    Notes
    -----
    Between two crossings of the imaginary axis the number of unstable poles is constant: that of
    the board itself and the changes at the crossings give it everywhere (see `parameter_loci`).

    Examples
    --------
    >>> import taction
    >>> board = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> [[f"{farads:.4g}" for farads in pair] for pair in capacitance_ranges(board).stable]
    [['9.023e-12', '3e-10']]
    """
    board = LinearBoard.of(circuit)
    own = board.circuit.scalings.capacitance
    count = (poles(board) if found is None else found).unstable_count
    ports = PortResponse(board, signal_capacitors(board.circuit))
    loci = trace_loci(ports, 1.0 / around, around)
    stable = tuple((own * low, own * high) for low, high in _stable(loci, count))
    return CapacitanceRanges(
        own * loci.low, own * loci.high, stable, tuple(own * share for share in loci.near)
    )


def _stable(loci: Loci, own: int) -> list[tuple[float, float]]:
    """Return the ranges of the share without unstable poles; the share 1 has `own` of them."""
    edges = [loci.low, *sorted(each.share for each in loci.crossings), loci.high]
    change = {each.share: 0 for each in loci.crossings}
    for each in loci.crossings:
        change[each.share] += each.change
    ranges: list[tuple[float, float]] = []
    for low, high in pairwise(edges):
        inside = math.sqrt(low * high)
        below = sum(by for share, by in change.items() if inside < share <= 1.0)
        above = sum(by for share, by in change.items() if 1.0 < share < inside)
        if high <= low or own + below - above:
            continue
        if ranges and ranges[-1][1] == low:  # the pole that crosses there is not the first
            ranges[-1] = (ranges[-1][0], high)
        else:
            ranges.append((low, high))
    return ranges
