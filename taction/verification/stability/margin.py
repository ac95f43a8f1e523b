"""Stability margins: the factor by which a knob can move until a stable board oscillates.

A margin is the nearest edge over a knob of the board, such as its C or its gain. Poles on both
sides and on the way there confirm it, and a winding number that needs no poles.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import partial

from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.system.errors import EngineError, TactionError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.certificate import WIDE
from taction.verification.stability.edges import Edges
from taction.verification.stability.families import (
    EdgeSearch,
    Family,
    all_but_a_knob,
    edges_together,
)
from taction.verification.stability.poles import Poles, or_error, poles, poles_together

REACH = 100.0  # the largest factor
CLOSE, DECADES = 1e-6, 4  # relative distance of the poles that confirm an edge, and farther
SAME = 1e-12  # relative distance of edges that count as one
ALIKE = 1e-9  # relative distance of values at which the same poles confirm an edge
AROUND = 30.0  # stable values: from the board's own value / 30 to its value * 30


@dataclass(frozen=True, slots=True)
class Margin:
    """A stability margin in one knob.

    Attributes
    ----------
    factor : float
        The least factor, above 1, at which a pole crosses the imaginary axis; the largest factor
        of the search if no pole crosses up to there; 0 for an unstable board.
    uncertainty : float
        Bound on the error of `factor`; 0 if no pole crosses.
    text : str
        The same in words.
    doubt : str
        Why the margin may be smaller; empty if that is excluded.
    """

    factor: float
    uncertainty: float
    text: str
    doubt: str = ""


def margins(board: LinearBoard, found: Poles) -> dict[str, Margin]:
    """Return the margins of a board with its poles, by the last word of the knob's key."""
    knobs = [knob for knob in board.circuit.knobs if knob.margin]
    return {
        knob.key.rpartition(".")[2]: find_margin(board, knob.name, found=found) for knob in knobs
    }


class Families:
    """The values at which poles have confirmed edges of linear boards, for many margins.

    Boards that differ only in the knob of the margin are the same board at a value of it. Each
    finds its edges itself: its digits do not depend on which boards are measured with it.
    """

    def __init__(self) -> None:
        self._confirmed: dict[Hashable, list[float]] = {}

    def confirmed(self, circuit: Circuit, knob: Knob) -> list[float]:
        """Return the values for boards like this one; `find_margin` adds to them."""
        if not circuit.is_linear:
            return []
        rest, numbers = all_but_a_knob(circuit, knob)
        return self._confirmed.setdefault((rest, numbers.tobytes()), [])


def first_knob(circuit: Circuit) -> str:
    """Return the name of the first knob with a margin; empty if there is none."""
    return next((knob.name for knob in circuit.knobs if knob.margin), "")


def stable_values(
    circuit: Circuit | LinearBoard,
    name: str = "",
    around: float = AROUND,
    found: Poles | None = None,
) -> Edges:
    """Find every edge of a knob within a factor of `around` of the board's own value.

    Parameters
    ----------
    name : str
        Of the knob; by default the one whose margin a scene limits.
    found : Poles, optional
        Poles of the board, if they have been computed before.

    Raises
    ------
    EngineError
        As `Family.edges` and `poles`.

    Examples
    --------
    >>> import taction
    >>> board = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> [[f"{farads:.4g}" for farads in pair] for pair in stable_values(board).stable_ranges]
    [['9.023e-12', '3e-10']]
    """
    board = LinearBoard.of(circuit)
    family = Family.of(board, board.circuit.knob(name or first_knob(board.circuit)))
    return family.edges(family.own / around, family.own * around, found)


def find_margin(
    circuit: Circuit | LinearBoard,
    name: str = "",
    reach: float = REACH,
    found: Poles | None = None,
    families: Families | None = None,
) -> Margin:
    """Find the factor by which a knob can move until a pole crosses the imaginary axis.

    The direction is that of the knob: C shrinks, the gain grows. R keeps its value.

    Parameters
    ----------
    name : str
        Of the knob: ``"C"``, ``"gain"``; by default the one whose margin a scene limits.
    reach : float
        The largest factor of interest.
    found : Poles, optional
        Poles of the board, if they have been computed before.
    families : Families, optional
        At which values margins of other boards were confirmed; this one adds to it.

    Raises
    ------
    EngineError
        As `taction.verification.stability.poles.poles`.

    Notes
    -----
    Costs the edges (`Family.edges`), and the poles of two or three boards.
    """
    search = MarginSearch(LinearBoard.of(circuit), name, reach, found)
    (margin,) = margins_together([search], families)
    if isinstance(margin, TactionError):
        raise margin
    return margin


@dataclass(frozen=True, slots=True)
class MarginSearch:
    """What `find_margin` gets."""

    board: LinearBoard
    name: str = ""
    reach: float = REACH
    found: Poles | None = None


def margins_together(
    searches: Sequence[MarginSearch], families: Families | None = None
) -> list[Margin | TactionError]:
    """Return the margin of each search, or why there is none; see `find_margin`.

    The edges of all boards are found together, with the digits of each alone.
    """
    begun = [or_error(partial(_begun, families=families), search) for search in searches]
    ways = [each for each in begun if not isinstance(each, Margin | TactionError)]
    every = iter(edges_together([search for _, search in ways]))
    return [
        each if isinstance(each, Margin | TactionError) else or_error(each[0].margin, next(every))
        for each in begun
    ]


def _begun(search: MarginSearch, families: Families | None) -> Margin | tuple[_Way, EdgeSearch]:
    """Return the way of the knob of a stable board; the margin of any other board."""
    board, name = search.board, search.name or first_knob(search.board.circuit)
    if not name:
        return Margin(1.0, 0.0, "no margin is known", "no key of this topology has a margin")
    own = poles(board) if search.found is None else search.found
    if own.known_stable:
        knob = board.circuit.knob(name)
        unit = board.circuit.facts[name].unit
        confirmed = [] if families is None else families.confirmed(board.circuit, knob)
        way = _Way(Family.of(board, knob), knob, unit, search.reach, confirmed)
        return way, EdgeSearch(way.family, *way.ends, own, nearest=True)
    if own.certain:
        return Margin(0.0, 0.0, "the board is unstable")
    text = "the board itself may be stable or unstable"
    return Margin(0.0, 0.0, text, text)


@dataclass(frozen=True, slots=True)
class _Way:
    """The way of a knob from the value of a stable board to where the board becomes unstable."""

    family: Family
    knob: Knob
    unit: str
    reach: float
    confirmed: list[float]

    @property
    def upwards(self) -> bool:
        """Whether the board becomes unstable as the value grows."""
        return self.knob.margin == "larger"

    def value(self, factor: float) -> float:
        """Return the value of the knob at a factor."""
        return self.family.own * factor if self.upwards else self.family.own / factor

    def factor(self, value: float) -> float:
        """Return the factor of a value of the knob."""
        return value / self.family.own if self.upwards else self.family.own / value

    @property
    def ends(self) -> tuple[float, float]:
        """Between which values the edge lies: one at `reach` is found with certainty."""
        end = self.value(self.reach * (1.0 + 2.0 * CLOSE))
        return min(self.family.own, end), max(self.family.own, end)

    def margin(self, edges: Edges | TactionError) -> Margin:
        """Confirm the first edge, or that there is none, by the poles beside it."""
        if isinstance(edges, EngineError):
            return Margin(1.0, 0.0, "no margin is known", str(edges))
        if isinstance(edges, TactionError):
            raise edges
        factors = [self.factor(edge.value) for edge in edges.edges]
        factor = min(factors, default=self.reach)
        near = sorted(self.factor(value) for value in edges.near)
        steps = range(1, math.ceil(math.log(factor, WIDE)))
        before = [*(by for by in near if by < factor), *(factor / WIDE**k for k in steps)]
        doubts = [self._doubt(by, edges) for by in before]
        if not factors:
            doubts.append(self._doubt(factor, edges))
            return Margin(factor, 0.0, f"no crossing up to {self._last}", _first(doubts))
        others = [by / factor - 1.0 for by in factors if by > factor * (1.0 + SAME)]
        room = 0.5 * min([factor - 1.0, *others])
        for distance in (min(CLOSE * 10.0**decade, room) for decade in range(DECADES)):
            sides = (factor / (1.0 + distance), factor * (1.0 + distance))
            beside = [self._doubt(by, edges) for by in sides]
            if not any(beside):
                break
        return Margin(factor, distance * factor, self._words(factor), _first(doubts + beside))

    @property
    def _last(self) -> str:
        if self.upwards:
            return f"{self.reach:g} times {self.knob.words}"
        return f"{self.knob.words}/{self.reach:g}"

    def _words(self, factor: float) -> str:
        moves = "grow" if self.upwards else "shrink"
        by = f"by the factor {factor:.4g}, to {show(self.value(factor), self.unit)}"
        return f"{self.knob.words} can {moves} {by}"

    def _doubt(self, by: float, edges: Edges) -> str:
        """Return why poles and winding number at a factor do not agree; empty if they do."""
        where, value = f"at the factor {by:.6g}", self.value(by)
        if any(abs(value - other) <= ALIKE * other for other in self.confirmed):
            return ""
        try:
            (found,) = poles_together([self.family.board(value)])
            if isinstance(found, TactionError):
                raise found
            wound = self.family.count(value, edges)
        except EngineError as error:
            return f"{where} there are no poles: {error}"
        if not found.certain:
            return f"{where} a pole is on the imaginary axis to within rounding"
        counted = found.unstable_count
        if counted == wound or (not found.complete and bool(counted) == bool(wound)):
            self.confirmed.append(value)
            return ""
        return f"{where} {counted} poles are unstable and the winding number is {wound}"


def _first(doubts: list[str]) -> str:
    return next(filter(None, doubts), "")
