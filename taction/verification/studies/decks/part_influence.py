"""What each part does to the stability of a linear board: sensitivities, and margins both ways."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from taction.system.array_types import Complexes
from taction.system.documents import HIDDEN, Hertz, Number, Rate
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edge
from taction.verification.stability.families import Family, find_edges
from taction.verification.stability.margin import REACH, Margin
from taction.verification.stability.poles import Poles
from taction.verification.stability.shown_poles import BAND

MOST_MARGINS = 12  # parts whose margins are found unless a margin is checked
MOST_UNKNOWNS = 150  # of a board with margins unless one is checked
MORE = 1.001  # of the largest factor: an edge at it is found with certainty
MOVED = 1e-5  # relative change of a value for a sensitivity
UNKNOWN = "not looked for"
LOST = 1e-9  # of the pole: a smaller rate is not known


@dataclass(frozen=True, slots=True)
class PartRow:
    """A part: what it does to the rightmost pole, and where the board becomes unstable."""

    name: str
    value: Number
    unit: str
    real: Rate  # d Re p / d ln value
    frequency: Hertz  # d f / d ln value
    # The nearest values with a pole on the imaginary axis, within a factor of 100; of a board that
    # is not stable those with which it is.
    below: Number = None
    above: Number = None
    doubt: str = ""  # why they are not known
    # These over the factor of the value; the factor up to which is no other in spite of a doubt.
    edges: Annotated[tuple[Edge, ...], HIDDEN] = ()
    sure: Annotated[float, HIDDEN] = math.inf


def sensitivities(
    board: LinearBoard, found: Poles, families: Mapping[str, Family]
) -> dict[str, complex]:
    """Return ``dp / d ln value`` of the rightmost pole p, 1/s, for every knob of parts.

    With ``(p M - K) v = 0`` and ``w (p M - K) = 0`` the pole moves by
    ``w (dK - p dM) v / (w M v)``, where the matrices are not linear in the value by a central
    difference. A rate that is lost in rounding beside the pole is zero.
    """
    if not len(found.poles) or board.descriptor.is_large:
        return {}
    p, point = found.rightmost, board.operating_point
    right, left = pole_vectors(board, p)
    scale = left @ board.matrices.mass @ right
    if not abs(scale) > 0.0:
        return {}
    rates = {}
    for name, family in families.items():
        if family.ports is not None and not board.circuit.knob(name).moves:
            rates[name] = complex(family.power * family.ports.rate(left, right, p) / scale)
            continue
        both = []
        for factor in (1.0 + MOVED, 1.0 - MOVED):
            moved = board.circuit.turned(name, board.circuit.value(name) * factor)
            there = LinearBoard(moved, point=point).matrices
            both.append(left @ (there.stiffness - p * there.mass) @ right)
        rates[name] = complex((both[0] - both[1]) / (2.0 * MOVED * scale))
    return {name: rate if abs(rate) > LOST * abs(p) else 0j for name, rate in rates.items()}


def pole_vectors(board: LinearBoard, p: complex) -> tuple[Complexes, Complexes]:
    """Return the right and the left null vector of ``p M - K``: of its least singular value."""
    X = p * board.matrices.mass - board.matrices.stiffness
    rows = np.abs(X).max(axis=1, keepdims=True)
    rows[rows == 0.0] = 1.0
    columns = np.abs(X / rows).max(axis=0)
    columns[columns == 0.0] = 1.0
    U, _, V = np.linalg.svd(X / rows / columns)
    return V[-1].conj() / columns, U[:, -1].conj() / rows[:, 0]


def influences(board: LinearBoard, found: Poles, every: bool = False) -> tuple[PartRow, ...]:
    """Return the rows of all parts, the most important first.

    Unless `every` part is to be looked at, the edges of a stable board are those of the
    `MOST_MARGINS` parts that move the rightmost pole most, and of a board of more than
    `MOST_UNKNOWNS` those of none.
    """
    c = board.circuit
    knobs = [knob for knob in c.knobs if knob.role]
    families = dict(zip([k.name for k in knobs], Family.of_each(board, knobs), strict=True))
    rates = sensitivities(board, found, families)
    order = sorted(rates, key=lambda name: -abs(rates[name].real))
    most = len(order) if every or found.known_unstable else MOST_MARGINS
    large = not every and board.descriptor.size > MOST_UNKNOWNS
    if large or found.stable is None or board.state_space.lost:
        most = 0
    rows = list[PartRow]()
    for k, name in enumerate(order):
        edges, doubt, sure = _nearest(families[name], found) if k < most else ((), UNKNOWN, 1.0)
        own, unit, rate = c.value(name), c.facts[name].unit, rates[name]
        ends = beside(own, edges)
        known = rate.real, rate.imag / math.tau, *ends
        rows.append(PartRow(name, own, unit, *known, doubt, edges, sure))
    return tuple(rows)


def beside(own: float, edges: Iterable[Edge]) -> tuple[Number, Number]:
    """Return the value at the edge below `own`, and at that above."""
    ends = [own * edge.value for edge in edges]
    return next((v for v in ends if v < own), None), next((v for v in ends if v > own), None)


def _nearest(family: Family, found: Poles) -> tuple[tuple[Edge, ...], str, float]:
    """Return the nearest edges over the factor of a value, which keeps its sign; of 0 none.

    Then a doubt, and the factor up to which is none. Of a board that is not stable the edges are
    the nearest ends of ranges in which it is.
    """
    reach, stable = REACH * MORE, found.known_stable
    if not family.own:
        return (), "", math.inf
    over = replace(family, board=lambda factor: family.board(family.own * factor), own=1.0)
    try:
        edges = find_edges(over, 1.0 / reach, reach, found)
    except EngineError as error:
        return (), str(error), 1.0
    seen = [edge for edge in edges.edges if edge.frequency <= BAND]  # no pole of a model beyond
    every = [edge for edge in seen if stable or edge.changes_stability]
    below = max((e for e in every if e.value < 1.0), key=lambda e: e.value, default=None)
    above = min((e for e in every if e.value > 1.0), key=lambda e: e.value, default=None)
    low, high = below.value if below else 0.0, above.value if above else math.inf
    near = [max(factor, 1.0 / factor) for factor in edges.near if low <= factor <= high]
    doubt = "a pole comes close to the axis" if near else ""
    return tuple(filter(None, (below, above))), doubt, min(near, default=math.inf)


def least_margin(board: LinearBoard, found: Poles, rows: Sequence[PartRow]) -> Margin:
    """Return the least margin of any part, from the rows of `every` part."""
    c = board.circuit
    if not found.known_stable:
        return Margin(0.0, 0.0, "the board is not stable")
    if not len(found.poles):
        gains = c.opamps or any(part.control for part in c.branches)
        active = gains or any(part.ohms <= 0.0 for part in c.resistors)
        doubt = "a source with gain may have another sign of its feedback" * bool(active)
        return Margin(REACH, 0.0, "no part makes a pole", doubt)
    if not rows:
        return Margin(1.0, 0.0, "no margin is known", "the board is too large")
    factor, bound, text = REACH, 0.0, f"no crossing up to a factor of {REACH:g} of any part"
    for row, edge in ((each, edge) for each in rows for edge in each.edges):
        if (by := max(edge.value, 1.0 / edge.value)) < factor:
            factor, bound = by, edge.bound * by / edge.value
            moves = "grow" if edge.value > 1.0 else "shrink"
            end = show(c.value(row.name) * edge.value, row.unit)
            text = f"{c.knob(row.name).words} can {moves} by the factor {by:.4g}, to {end}"
    doubts = (f"{row.name}: {row.doubt}" for row in rows if row.doubt and row.sure <= factor)
    return Margin(factor, bound, text, next(doubts, ""))
