"""What each part does to the stability of a linear board: sensitivities, and margins both ways."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from taction.netlist_gen.board.branches import ByCurrent, ByVoltage
from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.system.array_types import Complexes
from taction.system.documents import Hertz, Number, Rate
from taction.system.errors import EngineError, TactionError
from taction.system.frozen import frozen
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.state_space import linear_matrices
from taction.verification.stability.edges import Edges
from taction.verification.stability.families import EdgeSearch, Family, edges_together
from taction.verification.stability.margin import REACH, Margin, find_margin
from taction.verification.stability.poles import Poles, poles_together

MOST_MARGINS = 12  # parts whose margins are found unless a margin is checked
BESIDE = (1e-10, 1e-7, 1e-4, 1e-2)  # of the inverse iteration: relative distances from the pole
ITERATIONS = 3
BEYOND = 1.0 + 1e-4  # factor from a nearest stable value to one inside the stable range
MOVED = 1e-5  # relative change of a value for a sensitivity


@frozen
class PartRow:
    """A part: what it does to the rightmost pole, and where the board becomes unstable.

    `real` is d Re p / d ln value, 1/s, `frequency` d f / d ln value, Hz; `below` and `above` are
    the nearest values with a pole on the imaginary axis, None where there is none within a factor
    of 100, or where they were not looked for. Of a board that is not stable they are the nearest
    values with which it is stable.
    """

    name: str
    value: Number
    unit: str
    real: Rate
    frequency: Hertz
    below: Number = None
    above: Number = None
    doubt: str = ""


def sensitivities(
    board: LinearBoard, found: Poles, families: Mapping[str, Family] | None = None
) -> dict[str, complex]:
    """Return ``dp / d ln value`` of the rightmost pole p, 1/s, for every knob of parts.

    With ``(p M - K) v = 0`` and ``w (p M - K) = 0`` the pole moves by
    ``w (dK - p dM) v / (w M v)``. The matrices are linear in capacitances, conductances and gains;
    a central difference of `MOVED` errs by 1e-10 where they are not. `families` are the boards over
    each knob, where these are known.

    Examples
    --------
    >>> from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
    >>> from taction.verification.stability.poles import poles
    >>> flat = read_cards(["v1 in 0 1", "r1 in out 1k", "c1 out 0 1n"])
    >>> board = LinearBoard(circuit_of(flat, "rc", ["out"], {}))
    >>> {name: round(rate.real) for name, rate in sensitivities(board, poles(board)).items()}
    {'R1': 1000000, 'C1': 1000000}
    """
    if not len(found.poles) or board.descriptor.is_large:
        return {}
    p, point = found.rightmost, board.operating_point
    right, left = _vectors(board, p)
    known = board.descriptor
    dense = linear_matrices(known, point)
    scale = left @ dense.mass @ right
    if not abs(scale) > 0.0:
        return {}
    rates = {}
    for knob in board.circuit.knobs:
        family = families.get(knob.name) if families else None
        if family is not None and family.ports is not None and not knob.moves:
            rate = family.power * family.ports.rate(left, right, p)
            rates[knob.name] = rate / complex(scale)
        elif knob.role:
            own, both = board.circuit.value(knob.name), []
            for factor in (1.0 + MOVED, 1.0 - MOVED):
                moved = LinearBoard(board.circuit.turned(knob.name, own * factor), point=point)
                there = linear_matrices(moved.descriptor, point)
                both.append(left @ (there.stiffness - p * there.mass) @ right)
            rates[knob.name] = complex((both[0] - both[1]) / (2.0 * MOVED * scale))
    return rates


def _vectors(board: LinearBoard, p: complex) -> tuple[Complexes, Complexes]:
    """Return the right and the left null vector of ``p M - K``, by inverse iteration."""
    dense = linear_matrices(board.descriptor, board.operating_point)
    for beside in BESIDE:
        X = (p * (1.0 + beside) + 1e-300) * dense.mass - dense.stiffness
        rows = np.abs(X).max(axis=1)
        rows[rows == 0.0] = 1.0
        columns = np.abs(X / rows[:, None]).max(axis=0)
        columns[columns == 0.0] = 1.0
        try:
            inverse = np.linalg.inv(X / rows[:, None] / columns)
            break
        except np.linalg.LinAlgError:  # a pole that is exact, or a double one
            continue
    else:
        raise EngineError("the vectors of the rightmost pole are lost in rounding")
    right = left = np.ones(len(X), dtype=np.complex128)
    for _ in range(ITERATIONS):
        right = inverse @ (right / np.abs(right).max())
        left = (left / np.abs(left).max()) @ inverse
    return right / np.abs(right).max() / columns, left / np.abs(left).max() / rows


def influences(
    board: LinearBoard, found: Poles, every: bool
) -> tuple[Margin | None, tuple[PartRow, ...]]:
    """Return the least margin of any part, and the rows of all parts, the most important first.

    The margin is None unless `every` part was to be looked at; else the edges of a stable board are
    those of the `MOST_MARGINS` parts that move the rightmost pole most.
    """
    c = board.circuit
    knobs = [knob for knob in c.knobs if knob.role]
    families = dict(zip([k.name for k in knobs], Family.of_each(board, knobs), strict=True))
    rates = sensitivities(board, found, families)
    order = sorted(rates, key=lambda name: -abs(rates[name].real))
    looked = order if every or found.known_unstable else order[:MOST_MARGINS]
    if not found.certain:
        looked = []
    nearest, rows = dict.fromkeys(order, _Nearest()), list[PartRow]()
    nearest |= _nearest_of({name: families[name] for name in looked}, found)
    for name in order:
        edges = nearest[name]
        rate, unit = rates[name], c.facts[name].unit
        frequency, ends = rate.imag / math.tau, (edges.below, edges.above, edges.doubt)
        rows.append(PartRow(name, c.value(name), unit, rate.real, frequency, *ends))
    if not every:
        return None, tuple(rows)
    if not found.known_stable:
        return Margin(0.0, 0.0, "the board is not stable"), tuple(rows)
    if not len(found.poles):
        doubt = "" if _is_passive(c) else "a source with gain may have another sign of its feedback"
        return Margin(REACH, 0.0, "no part makes a pole", doubt), tuple(rows)
    return _least(board, nearest, found), tuple(rows)


def _is_passive(circuit: Circuit) -> bool:
    """Whether no source has a gain, and no resistor a negative value."""
    gains = any(isinstance(part, ByVoltage | ByCurrent) for part in circuit.branches)
    positive = all(part.ohms > 0.0 for part in circuit.resistors)
    return positive and not gains and not circuit.opamps


@frozen
class _Nearest:
    """The nearest edges below and above a value; a doubt, and the factor up to which is none."""

    below: float | None = None
    above: float | None = None
    doubt: str = ""
    sure: float = math.inf


def _nearest_of(families: Mapping[str, Family], found: Poles) -> dict[str, _Nearest]:
    """Return the nearest edges of values above zero, by name."""
    looked = {
        name: EdgeSearch(family, family.own / REACH, family.own * REACH, found)
        for name, family in families.items()
        if family.own > 0.0 and family.ports is not None
    }
    nearest: dict[str, _Nearest] = {}
    for (name, one), edges in zip(
        looked.items(), edges_together(list(looked.values())), strict=True
    ):
        if isinstance(edges, EngineError):
            nearest[name] = _Nearest(doubt=str(edges), sure=1.0)
        elif isinstance(edges, TactionError):
            raise edges
        else:
            nearest[name] = _nearest(one.family.own, edges, found.known_stable)
            if not found.known_stable:
                nearest[name] = _confirmed(nearest[name], one.family, edges)
    return nearest


def _confirmed(nearest: _Nearest, family: Family, edges: Edges) -> _Nearest:
    """Return the nearest stable values, without those beside which poles are not all stable."""
    inside = [
        max(high / BEYOND, math.sqrt(low * high)) if high == nearest.below
        # the other side of the board's own value
        else min(low * BEYOND, math.sqrt(low * high))
        for low, high in edges.stable_ranges
        if high == nearest.below or low == nearest.above
    ]  # fmt: skip
    found = poles_together([family.board(value) for value in inside])
    if all(isinstance(each, Poles) and each.known_stable for each in found):
        return nearest
    return _Nearest(doubt="the poles do not confirm the stable values")


def _nearest(own: float, edges: Edges, stable: bool) -> _Nearest:
    """Return the nearest edges of a value, and where a pole may reach the axis before them.

    Of a board that is not stable they are the nearest ends of ranges in which it is.
    """
    values = [edge.value for edge in edges.edges]
    if not stable:
        values = [end for ends in edges.stable_ranges for end in ends]
    below = max((value for value in values if value < own), default=None)
    above = min((value for value in values if value > own), default=None)
    inside = [v for v in edges.near if (below or 0.0) <= v <= (above or math.inf)]
    if not inside:
        return _Nearest(below, above)
    sure = min(max(v / own, own / v) for v in inside)
    return _Nearest(below, above, "a pole comes close to the axis", sure)


def _least(board: LinearBoard, nearest: Mapping[str, _Nearest], found: Poles) -> Margin:
    """Return the least margin of all parts, confirmed by poles on both sides of its edge."""
    factors = {}
    for part, edges in nearest.items():
        own = board.circuit.value(part)
        if edges.below is not None:
            factors[part, "below"] = own / edges.below
        if edges.above is not None:
            factors[part, "above"] = edges.above / own
    first = next(iter(nearest))
    name, side = min(factors, key=factors.__getitem__, default=(first, "above"))
    knob = replace(board.circuit.knob(name), margin=WAYS[side])
    least = find_margin(_turning(board, knob), name, REACH, found)
    if not factors:
        least = replace(least, text=f"no crossing up to a factor of {REACH:g} of any part")
    doubts = (
        f"{part}: {edges.doubt}"
        for part, edges in nearest.items()
        if edges.doubt and edges.sure <= least.factor
    )
    return replace(least, doubt=least.doubt or next(doubts, ""))


WAYS: Mapping[str, Literal["smaller", "larger"]] = {"below": "smaller", "above": "larger"}


def _turning(board: LinearBoard, knob: Knob) -> LinearBoard:
    """Return the same board with one knob; what is known of the board stays known."""
    other = LinearBoard(replace(board.circuit, knobs=(knob,)), board.descriptor, board.point)
    for name in ("state_space", "equilibrium"):
        if name in board.__dict__:
            other.__dict__[name] = board.__dict__[name]
    return other
