"""Stability margins: the factor by which a knob can move until a stable board oscillates.

A margin is the nearest edge over a knob of the board, such as its C or its gain, which poles on
both sides and on the way there confirm.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from contextlib import suppress
from dataclasses import dataclass

from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edges, Scan
from taction.verification.stability.families import Family, all_but_a_knob, find_edges
from taction.verification.stability.poles import Poles, poles

REACH = 100.0  # the largest factor
KEPT = 32  # kinds of boards whose edges are kept
DIGITS = 9  # of a margin: edges that boards share differ beyond them by where they were found
WIDER = 10.0  # times: by so much the edges that are kept go beyond the values seen
CLOSE = 1e-6  # relative distance behind `REACH` up to which edges are searched
UNKNOWN = "a pole is on the imaginary axis to within rounding, or no pole is known"
AROUND = 30.0  # stable values: from the board's own value / 30 to its value * 30


@dataclass(frozen=True, slots=True)
class Margin:
    """A stability margin in one knob."""

    # The least factor, above 1, at which a pole crosses the imaginary axis; the largest factor of
    # the search if no pole crosses up to there; 0 for an unstable board.
    factor: float
    uncertainty: float  # bound on the error of `factor`; 0 if no pole crosses
    text: str  # the same in words
    doubt: str = ""  # why the margin may be smaller; empty if that is excluded


def margins(board: LinearBoard, found: Poles) -> dict[str, Margin]:
    """Return the margins of a board with its poles, by the last word of the knob's key."""
    knobs = [knob for knob in board.circuit.knobs if knob.margin]
    return {
        knob.key.rpartition(".")[2]: find_margin(board, knob.name, found=found) for knob in knobs
    }


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

    `name`: of the knob; by default the one whose margin a scene limits.
    `found`: poles of the board, if they have been computed before.
    EngineError: as `find_edges` and `poles`.
    """
    board = LinearBoard.of(circuit)
    family = Family.of(board, board.circuit.knob(name or first_knob(board.circuit)))
    return find_edges(family, family.own / around, family.own * around, found)


def find_margin(
    circuit: Circuit | LinearBoard,
    name: str = "",
    reach: float = REACH,
    found: Poles | None = None,
) -> Margin:
    """Find the factor by which a knob can move until a pole crosses the imaginary axis.

    The direction is that of the knob: C shrinks, the gain grows. R keeps its value.

    `name`: of the knob: ``"C"``, ``"gain"``; by default the one whose margin a scene limits.
    `reach`: the largest factor of interest.
    `found`: poles of the board, if they have been computed before.
    EngineError: as `taction.verification.stability.poles.poles`.
    """
    board = LinearBoard.of(circuit)
    name = name or first_knob(board.circuit)
    if not name:
        return Margin(1.0, 0.0, "no margin is known", "no key of this topology has a margin")
    found = poles(board) if found is None else found
    if found.known_unstable:
        return Margin(0.0, 0.0, "the board is unstable; taction onset finds where not")
    if not found.known_stable:
        text = "the board itself may be stable or unstable"
        return Margin(0.0, 0.0, text, text)
    way = _Way(board, board.circuit.knob(name), reach)
    try:
        return way.margin(way.edges(found))
    except EngineError as error:
        return Margin(1.0, 0.0, "no margin is known", str(error))


@dataclass(frozen=True, slots=True, eq=False)
class _Way:
    """The way of a knob from a stable board to where it becomes unstable."""

    board: LinearBoard
    knob: Knob
    reach: float

    @property
    def own(self) -> float:
        """The board's value of the knob."""
        return self.board.circuit.value(self.knob.name)

    @property
    def upwards(self) -> bool:
        """Whether the board becomes unstable as the value grows."""
        return self.knob.margin == "larger"

    def value(self, factor: float) -> float:
        """Return the value of the knob at a factor."""
        return self.own * factor if self.upwards else self.own / factor

    def factor(self, value: float) -> float:
        """Return the factor of a value of the knob."""
        return value / self.own if self.upwards else self.own / value

    def edges(self, found: Poles) -> Edges:
        """Return edges with the first one on the way of the knob; errors as `find_edges`.

        Linear boards that differ in nothing but the knob share theirs: the second one finds them.
        """
        # an edge at the largest factor is found, too
        low, high = sorted((self.own, self.value(self.reach * (1.0 + 2.0 * CLOSE))))
        family = Family.of(self.board, self.knob)
        key: Hashable = None
        if self.board.circuit.is_linear:
            rest, numbers = all_but_a_knob(self.board.circuit, self.knob)
            key = rest, numbers.tobytes(), self.reach
        least, most, shared = _SHARED.pop(key, (low, high, None))
        if not least <= low <= high <= most:
            least, most = min(least, low) / WIDER, max(most, high) * WIDER
            with suppress(EngineError):
                shared = find_edges(family, least, most, found)
            if shared is None or shared.near or isinstance(shared, Scan):
                least, most, shared = 0.0, math.inf, None  # each board finds its own
        if key is not None:
            while len(_SHARED) >= KEPT:
                _SHARED.pop(next(iter(_SHARED)), None)
            _SHARED[key] = least, most, shared
        return shared or find_edges(family, low, high, found, nearest=True)

    def margin(self, edges: Edges) -> Margin:
        """Return the factor of the first edge, and what leaves a doubt before it."""
        last = self.reach * (1.0 + 2.0 * CLOSE)
        ahead = {f: e for e in edges.edges if 1.0 < (f := self.factor(e.value)) <= last}
        factor = min(ahead, default=self.reach)
        near = sorted(by for at in edges.near if 1.0 < (by := self.factor(at)) <= factor)
        doubt = f"at the factor {near[0]:.6g} {UNKNOWN}" if near else ""
        if not ahead:
            times = f"{self.reach:g} times {self.knob.words}"
            end = times if self.upwards else f"{self.knob.words}/{self.reach:g}"
            return Margin(factor, 0.0, f"no crossing up to {end}", doubt)
        first = ahead[factor]
        bound = max(first.bound / first.value, 10.0 ** (1 - DIGITS))
        factor = float(f"{factor:.{DIGITS}g}")  # the same whichever board found the edges
        return Margin(factor, bound * factor, self._words(factor), doubt)

    def _words(self, factor: float) -> str:
        moves = "grow" if self.upwards else "shrink"
        unit = self.board.circuit.facts[self.knob.name].unit
        by = f"by the factor {factor:.4g}, to {show(self.value(factor), unit)}"
        return f"{self.knob.words} can {moves} {by}"


_SHARED: dict[Hashable, tuple[float, float, Edges | None]] = {}
"""Of the last boards that differ only in the knob: the values seen, or searched, and the edges."""
