"""A board without a scene whose parts vary: over one value, in samples and in worst corners.

Corners and Monte Carlo are those of scenes; outputs at rest are compared with the nominal ones.
Tolerances are from a small TOML file: a kind counts outside of subcircuits; a name in ``[parts]``,
with * and ? for any letters, anywhere.
"""

from __future__ import annotations

import difflib
import fnmatch
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import parameters, varying_parts
from taction.netlist_gen.scene.axes import SweepAxis, range_values
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.fields import Model
from taction.netlist_gen.scene.keys import Key
from taction.netlist_gen.scene.mistakes import validated
from taction.netlist_gen.scene.scene import read_toml
from taction.system.array_types import Floats
from taction.system.documents import Hertz, Number, Rate
from taction.system.errors import Complaint, EngineError, InputError
from taction.system.quantities import UNITS, fraction
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edges, Range, scan
from taction.verification.stability.families import Family, find_edges
from taction.verification.stability.poles import poles
from taction.verification.stability.shown_poles import told_apart
from taction.verification.studies.decks.foreign_board import ForeignBoard
from taction.verification.studies.decks.measured_board import MeasuredBoard, measure_board
from taction.verification.studies.decks.questions import QUESTIONS, Wanted, record_of, units
from taction.verification.studies.tolerance.montecarlo import BoardSample, Quantity, Varied

LARGEST = 10.0  # of a tolerance: the value is up to 11 times as large
ACCEPTED = (
    'a file of tolerances in TOML: resistor = "1%", capacitor = "5%", coil, coupling, gain,'
    ' distribution, and a table [parts] with R1 = "0.1%"'
)


def _share(value: object) -> float:
    """Return a fraction from ``"5%"`` or 0.05."""
    with suppress(ValueError):
        if 0.0 <= (share := fraction(value)) <= LARGEST:
            return share
    raise ValueError(f'expected a share from 0 to {LARGEST:g}, such as "5%" or 0.05')


Share = Annotated[float, BeforeValidator(_share)]


class _File(Model):
    """The keys of a file."""

    resistor: Share | None = None
    capacitor: Share | None = None
    coil: Share | None = None
    coupling: Share | None = None
    gain: Share | None = None
    distribution: Literal["normal", "uniform"] = "normal"
    parts: dict[str, Share] = Field(default_factory=dict)


def read_tolerances(file: str | Path, circuit: Circuit) -> Tolerances:
    r"""Return the tolerances of single parts, those above zero; all others are exact.

    `circuit`: of a deck.
    InputError: the file cannot be read, has a key or a value that is none, or names no part; all
      mistakes.
    """
    path, found, wrong = Path(file), _File(), list[Complaint]()
    data, _ = read_toml(path, ACCEPTED)
    table = data.get("tolerances", data)
    if not isinstance(table, dict):
        raise InputError(path, Complaint("tolerances", repr(table)[:80], f"expected {ACCEPTED}"))
    try:
        found = validated(_File, table, path)
    except InputError as error:
        wrong += error.complaints
    kinds = {key: kind for key, kind in varying_parts(circuit) if kind in _File.model_fields}
    lower = {name.lower(): name for name in kinds}
    named = table.get("parts")
    for key in named if isinstance(named, dict) else ():
        if not fnmatch.filter(lower, key.lower()):
            near = difflib.get_close_matches(key.lower(), lower, n=1, cutoff=0.0)
            more = f"; the nearest is {near[0]!r}" if near else "; it has none"
            text = f"no part of the deck has this name{more}"
            wrong.append(Complaint(f"parts.{key}", "", text))
    parts = {name: getattr(found, kind) for name, kind in kinds.items() if "." not in name}
    for key, share in found.parts.items():
        parts |= {lower[name]: share for name in fnmatch.filter(lower, key.lower())}
    parts = {name: share for name, share in parts.items() if share}
    for branch in circuit.branches:
        share, size = parts.get(branch.label, 0.0), abs(branch.value)
        if branch.letter == "K" and share and size * (1.0 + share) >= 1.0:
            most = 100.0 * (1.0 / size - 1.0)
            text = f"reaches 1 within its tolerance; expected less than {most:.2g} %"
            given = f"{branch.value:g} ± {100.0 * share:g} %"
            wrong.append(Complaint(branch.label, given, text))
    if not (wrong or parts):
        wrong.append(Complaint("tolerances", "", "nothing varies; expected " + ACCEPTED))
    if wrong:
        raise InputError(path, *wrong)
    exact = dict.fromkeys(("resistor", "capacitor", "stray", "opamp_gbw", "opamp_gain"), 0.0)
    return Tolerances(distribution=found.distribution, parts=parts, **exact)


@dataclass(frozen=True, eq=False)
class VariedDeck(Varied):
    """The nominal board of a deck, its varied parts, and what is asked of its samples."""

    deck: ForeignBoard
    asked: Wanted

    @classmethod
    def of(
        cls, found: MeasuredBoard, deck: ForeignBoard, spread: Tolerances, asked: Wanted
    ) -> VariedDeck:
        """Return the boards around a measured one."""
        return cls(
            name=found.circuit.name,
            engine="statespace",
            nominal=found.circuit,
            varied=parameters(found.circuit, spread),
            tolerances=spread,
            quantities=tuple(_quantities(asked)),
            target=found.rest,
            step_amplitude=found.measurements.amplitude
            or float(np.abs(found.rest).max(initial=0.0))
            or 1.0,
            deck=deck,
            asked=asked,
        )

    def measured(self, number: int, z: Floats) -> BoardSample:
        """Return the sample with deviations `z`; `EngineError` where it cannot be measured."""
        board, band = LinearBoard(self.at(z)), self.asked.limits.settling_time.band
        asked, start = self.asked, self.deck.initial
        found = measure_board(board, start, band, asked.lowest, every=asked.margin)
        record = record_of(found, asked)
        errors = (found.rest - self.target) / self.step_amplitude
        off = float(np.abs(errors).max(initial=0.0))
        figures = {**record.figures, "steady_state_error": off}
        record = replace(record, figures=figures, channels=())
        return BoardSample(number, record, tuple(errors.tolist()))


def _quantities(asked: Wanted) -> Iterator[Quantity]:
    """Yield the questions with their limits, the distance from the nominal rest, and poles."""
    for question in QUESTIONS.values():
        if question.over or question.name in asked.names:
            limits = getattr(asked.limits, question.name, None)
            limit = asked.own.get(question.name, getattr(limits, "max", None))
            band = asked.limits.settling_time.band if question.second == "band" else None
            worse, name, unit = -1.0 if question.large else 1.0, question.name, question.unit
            least, most = (limit, None) if question.large else (None, limit)
            yield Quantity(name, unit, worse, least, most, band)
    yield Quantity("steady_state", "step")
    worse, least, most = (-1.0, 0.0, None) if asked.oscillates else (1.0, None, 0.0)
    yield Quantity("growth_rate", "1/s", worse, least, most)
    if asked.margin:
        yield Quantity("margin", "ratio", -1.0, at_least=asked.limits.stability.margin)


AROUND = 30.0  # range of a value without one
POINTS = 61  # of a range without a number of them
LISTED = 40  # names in a message
SAME = 1e-9  # relative distance of a point from an edge at which it counts as the edge


def swept_axis(text: str, deck: ForeignBoard) -> SweepAxis:
    """Read ``NAME`` of a part, or ``NAME=LOW:HIGH:POINTS`` of a part or a ``.param``."""
    name, _, body = (part.strip() for part in text.partition("="))
    lower, known = name.lower(), deck.deck.parameters
    parts = {knob.name.lower(): knob.name for knob in deck.circuit.knobs if knob.role}
    if lower not in parts and lower not in known:
        listed = ", ".join([*known, *parts.values()][:LISTED])
        raise InputError("--over", Complaint("name", repr(name), f"expected one of {listed}"))
    found = parts.get(lower, lower)
    unit = deck.circuit.facts[found].unit if lower in parts else ""
    key = Key(found, "real", unit)
    if body:
        read = replace(key, unit=unit if unit in UNITS else "ohm")
        values, scale = range_values(read, text, body, POINTS)
        return SweepAxis(key, found, values, scale)
    own = deck.circuit.value(found) if lower in parts else 0.0
    if not own > 0.0:
        raise InputError("--over", Complaint(name, "", f"expected {name}=LOW:HIGH:POINTS"))
    values = np.geomspace(own / AROUND, own * AROUND, POINTS).tolist()
    return SweepAxis(key, found, tuple(values), "log", default=True)


@dataclass(frozen=True, slots=True)
class PointRow:
    """A value of a sweep: the rightmost pole, its bound, and the answers of `QUESTIONS`."""

    value: Number
    real: Rate = None
    frequency: Hertz = None
    stable: bool | None = None
    bound: Rate = None
    failure: str = ""
    figures: Annotated[dict[str, float | None], {"inline": units(over=True)}] = field(
        default_factory=dict
    )


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A board over one value: every crossing of the imaginary axis, and readings at the values."""

    DOCUMENT = (*("name", "unit", "own", "crossings = edges.edges", "stable_ranges", "points"),)

    name: str
    unit: str
    own: Number  # of a part
    edges: Edges  # values at which a pole crosses the imaginary axis
    points: tuple[PointRow, ...]

    @property
    def stable_ranges(self) -> tuple[Range, ...]:
        """Parts of the range in which the board is stable, and every point in them, too."""
        return tuple(
            (low, high)
            for low, high in self.edges.stable_ranges
            if not any(low <= value <= high for value in self.doubtful)
        )

    @property
    def doubtful(self) -> tuple[float, ...]:
        """Values, other than crossings, that are not stable within a range that would be."""
        values = [point.value or 0.0 for point in self.points if not point.stable]
        values = [v for v in values if any(a <= v <= b for a, b in self.edges.stable_ranges)]
        crossings = [edge.value for edge in self.edges.edges]
        return tuple(v for v in values if not any(abs(v - e) <= SAME * abs(v) for e in crossings))


def sweep_deck(deck: ForeignBoard, board: LinearBoard, swept: SweepAxis, band: float) -> Sweep:
    """Find every crossing over one value, and the readings at each of the values."""
    values = [float(value) for value in swept.values]
    logarithmic = swept.scale != "lin" and min(values) > 0.0
    knob = next((k for k in deck.circuit.knobs if k.role and k.name == swept.name), None)
    family = Family.of(board, knob) if knob else Family.over(_over(deck, swept.name, values))
    at = cache(family.board)  # a scan and the readings share boards
    family = replace(family, board=at)

    def row(value: float) -> PointRow:
        try:
            found = measure_board(LinearBoard.of(at(value)), deck.initial, band)
        except (EngineError, InputError) as error:
            return PointRow(value, failure=str(error))
        poles, made = found.poles, PointRow(value, stable=found.poles.stable)
        for each in QUESTIONS.values():
            made.figures.update(each.figures(each.worst(found)) if each.over else {})
        if not len(poles.poles):
            return made
        real, hertz = poles.rightmost.real, poles.rightmost.imag / math.tau
        return replace(made, real=real, frequency=hertz, bound=poles.resolution)

    if not board.state_space.n:  # and so without a pole at any value of a part
        edges = Edges(min(values), max(values), ())
    elif told_apart(board, poles(board))[1].beyond:  # such poles of the models do not decide
        edges = scan(values, lambda v: told_apart(at(v), poles(at(v)))[0], logarithmic=logarithmic)
    elif family.ports is not None and logarithmic:
        edges = find_edges(family, min(values), max(values), values=values)
    else:
        edges = family.scan(values, logarithmic=logarithmic)
    own = deck.circuit.value(swept.name) if knob else None
    return Sweep(swept.name, swept.key.unit, own, edges, tuple(map(row, values)))


def _over(deck: ForeignBoard, name: str, values: Sequence[float]) -> Callable[[float], Circuit]:
    """Return the circuit as a function of a ``.param``; those at `values` are built at once."""
    known = dict(zip(values, deck.at(name, values), strict=True))

    def at(value: float) -> Circuit:
        found = known[value] if value in known else deck.at(name, [value])[0]
        if isinstance(found, InputError):
            raise found
        return found

    return at
