"""A board without a scene over one value: every crossing of stability, and its readings.

The values are those of a part or of a ``.param``: ``NAME=LOW:HIGH:POINTS``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.netlist_gen.scene.axes import range_values
from taction.netlist_gen.scene.keys import Key
from taction.system.documents import Hertz, Inline, Number, Rate
from taction.system.errors import Complaint, EngineError, InputError
from taction.system.quantities import UNITS
from taction.verification.engines.statespace.linearised.board import LinearBoard, solve_together
from taction.verification.stability.edges import Edge, Edges, Range
from taction.verification.stability.families import Family
from taction.verification.studies.foreign_board import ForeignBoard
from taction.verification.studies.measured_board import MeasuredBoard, measure_boards
from taction.verification.studies.questions import QUESTIONS, units

AROUND = 30.0  # range of a value without one
POINTS = 61  # of a range without a number of them
LISTED = 40  # names in a message
SAME = 1e-9  # relative distance of a point from an edge at which it counts as the edge


@dataclass(frozen=True, slots=True)
class SweptValue:
    """A value to sweep."""

    name: str  # of the part, as the deck writes it, or of the ``.param``
    knob: Knob | None  # of the part
    unit: str  # empty for a plain number
    own: float | None  # what the part has
    values: Sequence[float]  # SI base unit
    logarithmic: bool  # whether they are spaced by factors

    @classmethod
    def of(cls, text: str, deck: ForeignBoard) -> SweptValue:
        """Read ``NAME``, ``NAME=LOW:HIGH`` or ``NAME=LOW:HIGH:POINTS``."""
        name, _, body = (part.strip() for part in text.partition("="))
        circuit, lower = deck.circuit, name.lower()
        parts = {knob.name.lower(): knob for knob in circuit.knobs if knob.role}
        knob, known = parts.get(lower), deck.parameters
        if knob is None and lower not in known:
            listed = ", ".join([*known, *(each.name for each in parts.values())][:LISTED])
            raise InputError("--over", Complaint("name", repr(name), f"expected one of {listed}"))
        own = circuit.value(knob.name) if knob else deck.value_of(lower)
        unit = circuit.facts[knob.name].unit if knob else ""
        found = knob.name if knob else lower
        if body:
            key = Key(name, "real", unit if unit in UNITS else "ohm")
            read, scale = range_values(key, text, body, POINTS)
            values = [float(value) for value in read]
            spread = scale != "lin" and min(values) > 0.0
            return cls(found, knob, unit, own, values, spread)
        if own is None or not own > 0.0:
            raise InputError("--over", Complaint(name, "", f"expected {name}=LOW:HIGH:POINTS"))
        values = np.geomspace(own / AROUND, own * AROUND, POINTS).tolist()
        return cls(found, knob, unit, own, values, logarithmic=True)


@dataclass(frozen=True, slots=True)
class PointRow:
    """A value of a sweep: the rightmost pole, its bound, and the answers of `QUESTIONS`."""

    value: Number
    real: Rate
    frequency: Hertz
    stable: bool | None
    bound: Rate = None
    failure: str = ""
    figures: Annotated[dict[str, float | None], Inline(units(over=True))] = field(
        default_factory=dict
    )


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A board over one value: every crossing of the imaginary axis, and readings at the values."""

    DOCUMENT = (*("name", "unit", "own", "crossings", "stable_ranges", "points"),)

    name: str
    unit: str
    own: Number
    edges: Edges
    points: tuple[PointRow, ...]
    boards: tuple[MeasuredBoard | Exception, ...] = ()

    @property
    def crossings(self) -> tuple[Edge, ...]:
        """Values at which a pole crosses the imaginary axis."""
        return self.edges.edges

    @property
    def stable_ranges(self) -> tuple[Range, ...]:
        """Parts of the range in which the board is stable, and every point in them, too."""
        return tuple(
            (low, high)
            for low, high in self.edges.stable_ranges
            if not any(low <= value <= high for value in self.doubtful)
        )

    def beside_crossings(self, reach: int) -> tuple[int, ...]:
        """Return the numbers of the points next to a crossing, up to `reach` on either side."""
        values = [point.value or 0.0 for point in self.points]
        found = set[int]()
        for edge in self.crossings:
            above = sum(value < edge.value for value in values)
            found.update(range(max(above - reach, 0), min(above + reach, len(values))))
        return tuple(sorted(found))

    @property
    def doubtful(self) -> tuple[float, ...]:
        """Values, other than crossings, that are not stable within a range that would be."""
        values = [point.value for point in self.points if not point.stable]
        return tuple(
            value
            for value in values
            if value is not None
            and any(low <= value <= high for low, high in self.edges.stable_ranges)
            and not any(abs(value - e.value) <= SAME * abs(value) for e in self.crossings)
        )


def sweep_deck(deck: ForeignBoard, board: LinearBoard, swept: SweptValue, band: float) -> Sweep:
    """Find every crossing over one value, and the readings at each of the values.

    `board` is that of the deck, `band` that of the settling time.
    """
    values = swept.values
    family = Family.of(board, swept.knob) if swept.knob else Family.over(_over(deck, swept))
    family = replace(family, board=cache(family.board))  # a scan and the readings share boards
    boards = [_board(family, value) for value in values]
    solve_together([board for board in boards if isinstance(board, LinearBoard)])
    if not board.state_space.n:  # and so without a pole at any value of a part
        edges = Edges(min(values), max(values), ())
    elif family.ports is not None and swept.logarithmic:
        edges = family.edges(min(values), max(values), values=values)
    else:
        edges = family.scan(values, logarithmic=swept.logarithmic)
    measured = tuple(measure_boards(boards, deck.initial, band))
    points = tuple(map(_point, values, measured))
    return Sweep(swept.name, swept.unit, swept.own, edges, points, measured)


def _over(deck: ForeignBoard, swept: SweptValue) -> Callable[[float], Circuit]:
    """Return the circuit as a function of a ``.param``; those at `values` are built at once."""
    name, values = swept.name, swept.values
    known = dict(zip(values, deck.at([{name: value} for value in values]), strict=True))

    def at(value: float) -> Circuit:
        if value not in known:
            (known[value],) = deck.at([{name: value}])
        if isinstance(found := known[value], InputError):
            raise found
        return found

    return at


def _point(value: float, found: MeasuredBoard | Exception) -> PointRow:
    """Return the poles and the answers at a value."""
    if isinstance(found, Exception):
        return PointRow(value, None, None, None, failure=str(found))
    lead = found.poles.rightmost
    rates = (lead.real, lead.imag / math.tau, found.poles.resolution)
    real, frequency, bound = rates if len(found.poles.poles) else (None, None, None)
    figures = dict[str, float | None]()
    for each in QUESTIONS.values():
        if each.over:
            figures |= each.figures(each.worst(found))
    return PointRow(value, real, frequency, found.poles.stable, bound, figures=figures)


def _board(family: Family, value: float) -> LinearBoard | Exception:
    try:
        return LinearBoard.of(family.board(value))
    except (EngineError, InputError) as error:
        return error
