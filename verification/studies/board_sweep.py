"""A board without a scene over one value: every crossing of stability, and its readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.axes import range_values
from taction.netlist_gen.scene.keys import Key
from taction.system.documents import Hertz, Number, Rate, Seconds, Steps
from taction.system.errors import Complaint, EngineError, InputError
from taction.system.quantities import UNITS
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.readings.readings import Reading
from taction.verification.stability.edges import Edge, Edges
from taction.verification.stability.families import Family
from taction.verification.studies.measured_board import MeasuredBoard, Start, measure_boards

AROUND = 30.0  # range of a value without one
COLUMNS = ("settling_time", "rise_time", "overshoot", "undershoot")
POINTS = 61  # of a range without a number of them
Build = Callable[[str, Sequence[float]], Callable[[float], Circuit]]


@dataclass(frozen=True, slots=True)
class PointRow:
    """A value of a sweep: the rightmost pole, and readings of all outputs."""

    value: Number
    real: Rate
    frequency: Hertz
    stable: bool | None
    settling_time: Seconds = None
    rise_time: Seconds = None
    overshoot: Steps = None
    undershoot: Steps = None
    failure: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A board over one value: every crossing of the imaginary axis, and readings at the values."""

    DOCUMENT = (
        *("name", "unit", "own", "crossings", "stable_ranges = edges.stable_ranges"),
        "points",
    )

    name: str
    unit: str
    own: Number
    edges: Edges
    points: tuple[PointRow, ...]

    @property
    def crossings(self) -> tuple[Edge, ...]:
        """Values at which a pole crosses the imaginary axis."""
        return self.edges.edges


def sweep_board(
    board: LinearBoard, text: str, initial: Start, band: float, build: Build | None = None
) -> Sweep:
    """Find every crossing over one value, and the readings at each of the values.

    Parameters
    ----------
    text : str
        ``NAME``, ``NAME=LOW:HIGH`` or ``NAME=LOW:HIGH:POINTS``; NAME is a knob of the board.
    band : float
        Of the settling time.
    build : callable, optional
        Takes a name that is no knob, and values; returns the board as a function of the value.

    Raises
    ------
    InputError
        A name that the board does not have, or a range that is none.
    EngineError
        The board has no equilibrium, or no state-space form.
    """
    name, _, body = (part.strip() for part in text.partition("="))
    c = board.circuit
    folded = {knob.name.lower(): knob for knob in c.knobs if knob.role}
    knob = folded.get(name.lower())
    own = c.value(knob.name) if knob else None
    unit = c.facts[knob.name].unit if knob else ""
    known = ", ".join(each.name for each in folded.values())
    if not (body or knob):
        accepted = f"expected {name}=LOW:HIGH:POINTS, or one of {known}"
        raise InputError("--over", Complaint("name", repr(name), accepted))
    values, logarithmic = _values(name, text, body, own, unit)
    if knob is not None:
        family = Family.of(board, knob)
    else:
        if build is None:
            raise InputError("--over", Complaint("name", repr(name), f"expected one of {known}"))
        family = Family.over(build(name.lower(), values))
    if family.ports is not None and logarithmic:
        edges = family.edges(min(values), max(values))
    else:
        edges = family.scan(values, logarithmic=logarithmic)
    points = tuple(_points(family, values, initial, band))
    return Sweep(knob.name if knob else name, unit, own, edges, points)


def _values(
    name: str, text: str, body: str, own: float | None, unit: str
) -> tuple[list[float], bool]:
    """Return the values of a range, and whether they are spaced by factors."""
    if body:
        key = Key(name, "real", unit if unit in UNITS else "ohm")
        found, scale = range_values(key, text, body, POINTS)
        values = [float(value) for value in found]
        return values, scale != "lin" and min(values) > 0.0
    if own is None or not own > 0.0:
        raise InputError("--over", Complaint(name, "", f"expected {name}=LOW:HIGH:POINTS"))
    return np.geomspace(own / AROUND, own * AROUND, POINTS).tolist(), True


def _points(
    family: Family, values: Sequence[float], initial: Start, band: float
) -> Iterator[PointRow]:
    """Yield poles and readings at each value; those of all boards are measured at once."""
    boards = (_board(family, value) for value in values)
    for value, found in zip(values, measure_boards(boards, initial, band), strict=True):
        if isinstance(found, MeasuredBoard):
            lead = found.poles.rightmost
            readings = found.measurements.readings
            settling, rise, over, under = (_number(readings[name]) for name in COLUMNS)
            frequency, stable = lead.imag / math.tau, found.poles.stable
            yield PointRow(value, lead.real, frequency, stable, settling, rise, over, under)
        else:
            yield PointRow(value, None, None, None, failure=str(found))


def _number(reading: Reading | None) -> float | None:
    return None if reading is None else reading.value


def _board(family: Family, value: float) -> LinearBoard | Exception:
    try:
        return LinearBoard.of(family.board(value))
    except (EngineError, InputError) as error:
        return error
