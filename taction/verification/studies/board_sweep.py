"""A board without a scene over one value: every crossing of stability, and its readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated

from taction.netlist_gen.board.circuit import Circuit
from taction.system.documents import Hertz, Inline, Number, Rate
from taction.system.errors import EngineError, InputError
from taction.verification.engines.statespace.linearised.board import LinearBoard, solve_together
from taction.verification.stability.edges import Edge, Edges, Range
from taction.verification.stability.families import Family
from taction.verification.studies.measured_board import MeasuredBoard, Start, measure_boards
from taction.verification.studies.questions import QUESTIONS, units
from taction.verification.studies.swept_values import SweptValue

SAME = 1e-9  # relative distance of a point from an edge at which it counts as the edge
Build = Callable[[Sequence[Mapping[str, float]]], Sequence[Circuit | InputError]]
"""Returns the circuit at some values of ``.param`` cards, or why there is none."""


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


def sweep_board(
    board: LinearBoard, swept: SweptValue, initial: Start, band: float, build: Build | None = None
) -> Sweep:
    """Find every crossing over one value, and the readings at each of the values.

    Parameters
    ----------
    band : float
        Of the settling time.
    build : callable, optional
        Returns the circuit at values of ``.param`` cards.

    Raises
    ------
    EngineError
        The board has no equilibrium, or no state-space form.
    """
    values = swept.values
    if swept.knob is not None:
        family = Family.of(board, swept.knob)
    else:
        assert build is not None  # noqa: S101 - only decks have a .param
        family = Family.over(_over(build, swept.name, values))
    family = replace(family, board=cache(family.board))  # a scan and the readings share boards
    boards = [_board(family, value) for value in values]
    solve_together([board for board in boards if isinstance(board, LinearBoard)])
    if not board.state_space.n:  # and so without a pole at any value of a part
        edges = Edges(min(values), max(values), ())
    elif family.ports is not None and swept.logarithmic:
        edges = family.edges(min(values), max(values), values=values)
    else:
        edges = family.scan(values, logarithmic=swept.logarithmic)
    measured = tuple(measure_boards(boards, initial, band))
    points = tuple(map(_point, values, measured))
    return Sweep(swept.name, swept.unit, swept.own, edges, points, measured)


def _over(build: Build, name: str, values: Sequence[float]) -> Callable[[float], Circuit]:
    """Return the circuit as a function of a ``.param``; those at `values` are built at once."""
    known = dict(zip(values, build([{name: value} for value in values]), strict=True))

    def at(value: float) -> Circuit:
        if value not in known:
            (known[value],) = build([{name: value}])
        found = known[value]
        if isinstance(found, InputError):
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
