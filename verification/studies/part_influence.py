"""What each part does to the stability of a linear board: sensitivities, and margins both ways."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from taction.netlist_gen.board.circuit import Knob
from taction.system.array_types import Complexes
from taction.system.documents import Hertz, Number, Rate
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.state_space import linear_matrices
from taction.verification.stability.families import Family
from taction.verification.stability.margin import REACH, Margin, find_margin
from taction.verification.stability.poles import Poles

MOST_MARGINS = 12  # parts whose margins are found unless a margin is checked
MOVED = 1e-5  # relative change of a value for a sensitivity


@dataclass(frozen=True, slots=True)
class PartRow:
    """A part: what it does to the rightmost pole, and where the board becomes unstable.

    `real` is d Re p / d ln value, 1/s, `frequency` d f / d ln value, Hz; `below` and `above` are
    the nearest values with a pole on the imaginary axis, None where there is none within a factor
    of 100, or where they were not looked for.
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
    >>> board = LinearBoard(circuit_of(flat, "rc", ["out"], {}, 15.0))
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
        ports = families[knob.name].ports if families and knob.name in families else None
        if ports is not None and not knob.moves:
            rates[knob.name] = ports.rate(left, right, p) / complex(scale)
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
    X = (p * (1.0 + 1e-10) + 1e-300) * dense.mass - dense.stiffness
    rows = np.abs(X).max(axis=1)
    rows[rows == 0.0] = 1.0
    columns = np.abs(X / rows[:, None]).max(axis=0)
    columns[columns == 0.0] = 1.0
    scaled = X / rows[:, None] / columns
    U, _, Vh = np.linalg.svd(scaled)
    return Vh[-1].conj() / columns, U[:, -1].conj() / rows


def influences(
    board: LinearBoard, found: Poles, every: bool
) -> tuple[Margin | None, tuple[PartRow, ...]]:
    """Return the least margin of any part, and the rows of all parts, the most important first.

    The margin is None unless `every` part was to be looked at; else the edges are those of the
    `MOST_MARGINS` parts that move the rightmost pole most.
    """
    c = board.circuit
    families = {knob.name: Family.of(board, knob) for knob in c.knobs if knob.role}
    rates = sensitivities(board, found, families)
    order = sorted(rates, key=lambda name: -abs(rates[name].real))
    looked = (order if every else order[:MOST_MARGINS]) if found.known_stable else []
    rows = []
    for name in order:
        edges = _nearest(families[name], found) if name in looked else (None, None, "")
        rate, unit = rates[name], c.facts[name].unit
        frequency = rate.imag / math.tau
        rows.append(PartRow(name, c.value(name), unit, rate.real, frequency, *edges))
    if not every:
        return None, tuple(rows)
    if not looked:
        return Margin(0.0, 0.0, "the board is not stable"), tuple(rows)
    return _least(board, rows, found), tuple(rows)


def _nearest(family: Family, found: Poles) -> tuple[float | None, float | None, str]:
    """Return the nearest edges below and above the own value, and why they are in doubt."""
    own = family.own
    if not own > 0.0 or family.ports is None:
        return None, None, ""
    try:
        edges = family.edges(own / REACH, own * REACH, found)
    except EngineError as error:
        return None, None, str(error)
    values = [edge.value for edge in edges.edges]
    doubt = "a pole comes close to the axis" if edges.near else ""
    below = max((value for value in values if value < own), default=None)
    return below, min((value for value in values if value > own), default=None), doubt


def _least(board: LinearBoard, rows: list[PartRow], found: Poles) -> Margin:
    """Return the least margin of all parts, confirmed by poles on both sides of its edge."""
    factors = {}
    for row in rows:
        own = row.value or 1.0
        if row.below is not None:
            factors[row.name, "below"] = own / row.below
        if row.above is not None:
            factors[row.name, "above"] = row.above / own
    name, side = min(factors, key=factors.__getitem__, default=(rows[0].name, "above"))
    knob = replace(board.circuit.knob(name), margin=WAYS[side])
    least = find_margin(_turning(board, knob), name, REACH, found)
    if not factors:
        least = replace(least, text=f"no crossing up to a factor of {REACH:g} of any part")
    doubts = next((f"{row.name}: {row.doubt}" for row in rows if row.doubt), "")
    return replace(least, doubt=least.doubt or doubts)


WAYS: Mapping[str, Literal["smaller", "larger"]] = {"below": "smaller", "above": "larger"}


def _turning(board: LinearBoard, knob: Knob) -> LinearBoard:
    """Return the same board with one knob; what is known of the board stays known."""
    other = LinearBoard(replace(board.circuit, knobs=(knob,)), board.descriptor, board.point)
    for name in ("state_space", "equilibrium"):
        if name in board.__dict__:
            other.__dict__[name] = board.__dict__[name]
    return other
