"""Boards that differ in one number, and every edge of stability among them.

Where the number only scales equal parts, and the equilibrium stays, the loci of these parts find
every edge from one board (`loci`), and poles beside the edges confirm them (`certificate`).
Otherwise, and where poles do not confirm them, poles at samples of the number find them (`scan`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.spice_models.branches import Branch
from taction.system.array_types import Floats
from taction.system.errors import EngineError, InputError, TactionError
from taction.verification.engines.statespace.equations.pole_count import characteristic
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.certificate import (
    BESIDE,
    Count,
    EdgeClaim,
    certify,
    exact_count,
)
from taction.verification.stability.edges import Edges, Scan
from taction.verification.stability.loci import LociSearch, trace_together
from taction.verification.stability.poles import (
    Poles,
    count_unstable,
    or_error,
    poles,
    poles_together,
)
from taction.verification.stability.port_response import PortResponse
from taction.verification.stability.scan import scan

PER_DECADE, COUNTED = 20, 40  # values of the first grid of a scan: by poles, and by exact counts
Parts = tuple[Capacitor | Resistor, ...]
PRECISE = 1e-6  # largest relative bound of a pole of a board whose loci are trusted
APART, SAME = 1.01, 1e-9  # of two boards that are compared: ratio of their values, and tolerance


@dataclass(frozen=True, slots=True)
class Family:
    """Boards over one number."""

    # The board at a value; raises `InputError` or `EngineError` without one.
    board: Callable[[float], LinearBoard]
    own: float = 1.0  # a value in the middle of interest
    # The board at `own` with the parts that the number scales; None if more depends on it.
    ports: PortResponse | None = None
    # Of the number, to which the capacitances or conductances of these parts are proportional.
    power: float = 1.0

    @classmethod
    def of(cls, board: LinearBoard, knob: Knob) -> Family:
        """Return the boards that differ from `board` in one of its knobs."""
        (family,) = cls.of_each(board, [knob])
        return family

    @classmethod
    def of_each(cls, board: LinearBoard, knobs: Sequence[Knob]) -> list[Family]:
        """Return the boards that differ from `board` in a knob, for each of some knobs."""
        circuit, laws = board.circuit, list[str]()
        ports = dict[str, PortResponse | None]()
        scaled = scaled_parts(circuit, knobs)
        for knob, parts in zip(knobs, scaled, strict=True):
            if _is_reactive(parts) or (parts and not circuit.has_nonlinear_amplifiers):
                ports[knob.name] = PortResponse.of_parts(board, parts)
            elif not parts and circuit.is_linear and not circuit.scales_arrays(knob):
                laws.append(knob.name)
        ports |= zip(laws, PortResponse.of_laws(board, laws), strict=True)
        return [
            cls._of(board, knob, parts, ports.get(knob.name))
            for knob, parts in zip(knobs, scaled, strict=True)
        ]

    @classmethod
    def _of(
        cls, board: LinearBoard, knob: Knob, parts: Parts, ports: PortResponse | None
    ) -> Family:
        point = board.operating_point if _is_reactive(parts) else None  # it moves no equilibrium
        moved = partial(_moved, board.circuit, knob.name, point)
        power = -knob.power if parts and not _is_reactive(parts) else knob.power
        return cls(moved, board.circuit.value(knob.name), ports, power)

    @classmethod
    def over(
        cls,
        build: Callable[[float], Circuit],
        key: str = "",
        own: float | None = None,
    ) -> Family:
        """Return the boards that a function builds.

        Where the number is the `key` of one of their knobs, `own` is a value of it.
        """

        def board(value: float) -> LinearBoard:
            return LinearBoard(build(value))

        if not key or own is None:
            return cls(board)
        try:
            middle, near = board(own), build(APART * own)
            knobs = [k for k in middle.circuit.knobs if k.key == key and k.role]
            alone = [knob for knob in knobs if _follows(knob, middle.circuit, near)]
            if not alone:
                return cls(board, own)
            return replace(cls.of(middle, alone[0]), board=board, own=own)
        except (InputError, EngineError):
            return cls(board)

    def poles(self, value: float) -> Poles:
        """Return the poles at a value."""
        return poles(self.board(value))

    def edges(
        self,
        low: float,
        high: float,
        found: Poles | None = None,
        values: Sequence[float] = (),
    ) -> Edges:
        """Find every edge from `low` to `high` (above zero); `found`: poles at `own`.

        The edges agree with the poles at `values`, too.

        InputError, EngineError: no board, no equilibrium, no state-space form, or a pole at `own`
          is on the axis.

        Notes
        -----
        Costs the loci, or a scan: the poles of `PER_DECADE` boards per decade, and more.
        """
        (edges,) = edges_together([EdgeSearch(self, low, high, found, values=tuple(values))])
        if isinstance(edges, TactionError):
            raise edges
        return edges

    def scan(
        self,
        values: Sequence[float],
        *,
        logarithmic: bool = True,
        fine: bool = True,
        start: float | None = None,
        count: Count = lambda value: None,
    ) -> Scan:
        """Find every edge among `values`, with the poles at samples; see `scan`.

        With samples beside the edges of the loci no edge is too narrow to be found. The poles are
        those of `poles_together`: eigenvalues where these leave no side open.
        """
        beside = self._beside_edges(min(values), max(values)) if logarithmic else []
        return scan(
            [*values, *beside],
            lambda some: poles_together(or_error(self.board, value) for value in some),
            count=count,
            logarithmic=logarithmic,
            fine=fine,
            start=start,
        )

    def _beside_edges(self, low: float, high: float) -> list[float]:
        """Return values on both sides of the edges that the loci show."""
        if self.ports is None:
            return []
        (traced,) = trace_together([LociSearch(self.ports, *self.shares(low, high))])
        if isinstance(traced, EngineError):
            return []
        found = self.at_values(traced)
        places = [*(edge.value for edge in found.edges), *found.near]
        sides = (0.0, *(by for distance in BESIDE[:2] for by in (-distance, distance)))
        return [v for at in places for by in sides if low < (v := at * (1.0 + by)) < high]

    def shares(self, low: float, high: float) -> tuple[float, float]:
        """Return the shares of the parts of `ports` between two values, the smaller one first."""
        first, last = sorted(float((value / self.own) ** self.power) for value in (low, high))
        return first, last

    def at_values(self, found: Edges) -> Edges:
        """Return edges over the share of the parts of `ports` as edges over the number."""
        return found.mapped(lambda share: float(self.own * share ** (1.0 / self.power)))


def scaled_parts(circuit: Circuit, knobs: Sequence[Knob]) -> list[Parts]:
    """Return the parts that each knob scales: capacitors or resistors; none if also arrays."""
    parts: Parts = (*circuit.capacitors, *circuit.resistors)
    places = {part.card: place for place, part in enumerate(parts)}
    found = list[Parts]()
    for knob in knobs:
        names = () if circuit.scales_arrays(knob) else circuit.named(knob.role)
        own: Parts = tuple(
            parts[k] for k in sorted({places[name] for name in names if name in places})
        )
        found.append(tuple(part for part in own if isinstance(part, Capacitor)) or own)
    return found


def _is_reactive(parts: Sequence[Capacitor | Resistor]) -> bool:
    return bool(parts) and isinstance(parts[0], Capacitor)


def _moved(circuit: Circuit, name: str, point: Equilibrium | None, value: float) -> LinearBoard:
    return LinearBoard(circuit.turned(name, value), point=point)


@dataclass(frozen=True, slots=True)
class EdgeSearch:
    """A search for every edge of a family from `low` to `high`; `found`: poles at `own`.

    With `nearest` the board at `own`, one of the two, is stable, and only the edge next to it need
    be found and confirmed. The edges agree with the poles at `values`, too.
    """

    family: Family
    low: float
    high: float
    found: Poles | None = None
    nearest: bool = False
    values: tuple[float, ...] = ()

    def begun(self) -> tuple[LociSearch, Poles] | None:
        """Return the search by loci, and the poles at `own`; None where only a scan is left."""
        family = self.family
        if family.ports is None:
            return None
        own = poles(family.ports.board) if self.found is None else self.found
        known = own.complete or own.stable  # else the poles are too few to be counted
        count = own.unstable_count if known else count_unstable(family.ports.board)
        return LociSearch(family.ports, *family.shares(self.low, self.high), count), own

    def claim(self, own: Poles, traced: Edges, count: Count | None) -> EdgeClaim:
        """Return what is to be confirmed of the edges that the loci show."""
        edges, within = self.family.at_values(traced), (self.low, self.high)
        if self.nearest and edges.edges:
            upwards = self.family.own == self.low
            at = edges.edges[0 if upwards else -1].value
            within = (self.low, at) if upwards else (at, self.high)
        precise = own.complete and bool(np.all(own.errors <= PRECISE * np.abs(own.poles)))
        own_value, board = self.family.own, self.family.board
        return EdgeClaim(edges, board, within, own_value, self.values, count, precise)

    def scanned(self, count: Count | None = None) -> Edges:
        """Return the edges by poles at samples alone."""
        density = COUNTED if count else PER_DECADE
        points = 2 + math.ceil(density * math.log10(self.high / self.low))
        values = np.geomspace(self.low, self.high, points).tolist()
        values[0], values[-1] = self.low, self.high
        start, of = self.family.own if self.nearest else None, count or (lambda value: None)
        return self.family.scan([*values, *self.values], start=start, count=of)


def edges_together(searches: Sequence[EdgeSearch]) -> list[Edges | TactionError]:
    """Return the edges of each search, or why there are none; see `Family.edges`.

    The loci of all boards are followed together. Where poles do not confirm what they show, a scan
    finds the edges.
    """
    begun = [or_error(EdgeSearch.begun, one) for one in searches]
    loci = {k: each for k, each in enumerate(begun) if isinstance(each, tuple)}
    traced = dict(zip(loci, trace_together([one for one, _ in loci.values()]), strict=True))
    counts = _exact_counts({k: searches[k].family for k in loci})
    claims = {
        k: searches[k].claim(loci[k][1], edges, counts.get(k))
        for k, edges in traced.items()
        if isinstance(edges, Edges)
    }
    large = {k for k in claims if loci[k][0].ports.board.descriptor.is_large}
    asked = {k: each for k, each in claims.items() if k not in large or searches[k].nearest}
    certified: dict[int, Edges | None] = {k: each.edges for k, each in claims.items()}
    certified |= zip(asked, certify(list(asked.values())), strict=True)
    found = list[Edges | TactionError]()
    for k, one in enumerate(searches):
        failed = begun[k] if isinstance(begun[k], TactionError) else traced.get(k)
        if isinstance(failed, TactionError):
            found.append(failed)
        elif k in certified and (edges := certified[k]) is not None:
            found.append(edges)
        else:
            found.append(or_error(one.scanned, counts.get(k)))
    return found


def _exact_counts(families: Mapping[int, Family]) -> dict[int, Count]:
    """Return the count of unstable poles of each family of a deck over one part, by its place."""
    decks = {
        k: (family, family.ports.board)
        for k, family in families.items()
        if family.ports and family.ports.count == 1 and family.ports.board.descriptor.has_branches
    }
    doubled = {k: or_error(family.board, 2.0 * family.own) for k, (family, _) in decks.items()}
    boards = dict.fromkeys(board for _, board in decks.values())
    first, found = {b: characteristic(b.descriptor) for b in boards}, dict[int, Count]()
    for k, (family, board) in decks.items():
        own, there = first[board], doubled[k]
        second = characteristic(there.descriptor) if isinstance(there, LinearBoard) else None
        if own and second and abs(family.power) == 1.0:
            found[k] = exact_count(own, second, family.own, family.power)
    return found


def _follows(knob: Knob, first: Circuit, second: Circuit) -> bool:
    """Tell whether a knob alone leads from one board to another, without a series that rounds."""
    if abs(second.value(knob.name) / (APART * first.value(knob.name)) - 1.0) > SAME:
        return False
    (rest, numbers), (other, others) = (all_but_a_knob(each, knob) for each in (first, second))
    return rest == other and bool(np.allclose(numbers, others, rtol=SAME, atol=0.0))


def unrounded(scene: Scene, key: str) -> dict[str, Value]:
    """Return the keys of a scene with which no series rounds the parts of a knob."""
    knobs = topology_of(scene).knobs(scene)
    return {knob.series: "exact" for knob in knobs if knob.key == key and knob.series}


def all_but_a_knob(circuit: Circuit, knob: Knob) -> tuple[Hashable, Floats]:
    """Return what decides a linear board's poles: first what is no number, then all numbers.

    Those of a knob's parts are over the scale of its value, so boards of which both are equal
    differ in nothing but the value of the knob.
    """
    names, scale = circuit.named(knob.role), circuit.value(knob.name) ** knob.power
    parts: list[tuple[Resistor | Capacitor | Branch, float]] = [
        *((part, part.ohms) for part in circuit.resistors),
        *((part, part.farads) for part in circuit.capacitors),
        *((part, part.value) for part in circuit.branches),
    ]
    numbers = [value / scale if part.card in names else value for part, value in parts]
    arrays = [m.ohms.ravel() / (scale if m.name in names else 1.0) for m in circuit.matrices]
    matrices = [
        (
            m.negative.tobytes(),
            m.by_column,
            m.plus,
            m.minus,
            m.sinks,
            m.wires and m.wires.resistances,
        )
        for m in circuit.matrices
    ]
    rest = (
        knob.name,
        tuple(circuit.models.items()),
        circuit.opamps,
        tuple(matrices),
        tuple((part.card, part.a, part.b) for part, _ in parts),
        tuple(replace(part, value=1.0) for part in circuit.branches),
        tuple(source.node for source in circuit.voltages),
        circuit.supply,
    )
    return rest, np.concatenate([numbers, *arrays])
