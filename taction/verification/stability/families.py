"""Boards that differ in one number, and every edge of stability among them.

Where the number only scales equal parts, and the equilibrium stays, the loci of these parts find
every edge from one board (`loci`). Otherwise poles at samples of the number find them (`scan`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.table import topology_of
from taction.spice_models.branches import Branch
from taction.system.array_types import Floats
from taction.system.errors import EngineError, InputError, TactionError
from taction.verification.engines.statespace.equations.exact_count import characteristic
from taction.verification.engines.statespace.linearised.board import LinearBoard, stamp_boards
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.stability.certificate import EdgeClaim, ExactCount, certify, counted_edges
from taction.verification.stability.edges import Edges, Scan
from taction.verification.stability.loci import LociSearch, trace_together
from taction.verification.stability.poles import (
    Poles,
    count_unstable,
    or_error,
    poles,
    poles_together,
)
from taction.verification.stability.port_response import PortResponse, share_elimination
from taction.verification.stability.scan import TOLERANCE, scan

PER_DECADE = 20  # values of the first grid of a scan
APART_FROM_ZERO = 1e3  # times its bound: a pole beyond it is not at zero
Parts = tuple[Capacitor | Resistor, ...]
BESIDE = 1e-6  # relative distance of the samples beside an edge of the loci
PRECISE = 1e-6  # largest relative bound of a pole of a board whose loci are trusted
APART, SAME = 1.01, 1e-9  # of two boards that are compared: ratio of their values, and tolerance


@dataclass(frozen=True, slots=True)
class Family:
    """Boards over one number.

    Attributes
    ----------
    board : callable
        The board at a value; raises `InputError` or `EngineError` without one.
    own : float
        A value in the middle of interest.
    ports : PortResponse or None
        The board at `own` with the parts that the number scales; None if more depends on it.
    power : float
        Of the number, to which the capacitances or conductances of these parts are proportional.
    """

    board: Callable[[float], LinearBoard]
    own: float = 1.0
    ports: PortResponse | None = None
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
        known = [each for each in ports.values() if each]
        ports |= zip(laws, PortResponse.of_laws(board, laws), strict=True)
        for some in ([each for each in ports.values() if each], known):
            with suppress(EngineError):  # a capacitor at the source of a law
                share_elimination(some)
                break
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

        Raises
        ------
        InputError, EngineError
            No board, no equilibrium, no state-space form, or a pole at `own` is on the axis.

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
        tolerance: float = TOLERANCE,
        fine: bool = True,
        start: float | None = None,
    ) -> Scan:
        """Find every edge among `values`, with the poles at samples; see `scan`.

        With samples beside the edges of the loci no edge is too narrow to be found. The poles are
        those of `poles_together`: eigenvalues where these leave no side open.
        """
        located = self._located(min(values), max(values)) if logarithmic else []
        return scan(
            [*values, *located],
            self._read,
            logarithmic=logarithmic,
            tolerance=tolerance,
            fine=fine,
            start=start,
        )

    def _read(self, values: Sequence[float]) -> list[Poles | TactionError]:
        return poles_together(or_error(self.board, value) for value in values)

    def count(self, value: float, edges: Edges) -> int:
        """Count the unstable poles at a value by a winding number, without poles."""
        return edges.unstable_at(value) if self.ports else count_unstable(self.board(value))

    def shares(self, low: float, high: float) -> tuple[float, float]:
        """Return the shares of the parts of `ports` between two values, the smaller one first."""
        first, last = sorted((self._share(low), self._share(high)))
        return first, last

    def _share(self, value: float) -> float:
        return float((value / self.own) ** self.power)

    def at_values(self, found: Edges) -> Edges:
        """Return edges over the share of the parts of `ports` as edges over the number."""
        return found.mapped(lambda share: float(self.own * share ** (1.0 / self.power)))

    def confirmed(self, found: Edges, unstable: int, own: Poles | None = None) -> Edges:
        """Return the edges without those at which no real pole crosses; `unstable` is of `own`.

        A pole that stays at zero, such as that of a loop of coils, hides a locus there. An edge
        that rounding hides stays, and its value comes to the near ones. `own` are the poles at
        the value `own`, where a part of a deck may change the sign of ``det K``.
        """
        near, changes = list(found.near), list[tuple[float, float, int]]()
        for edge in found.edges:
            known = edge.frequency or self._is_simple(edge.value, own)
            crosses = True if known else self._crosses(edge.value)
            if crosses is None:
                near.append(edge.value)
            if crosses is not False:
                changes.append((edge.value, edge.frequency, edge.above - edge.below))
        if len(changes) == len(found.edges) and len(near) == len(found.near):
            return found
        return Edges.counted((found.low, found.high), changes, near, (self.own, unstable))

    def _is_simple(self, value: float, own: Poles | None) -> bool:
        """Tell whether a real pole is known to cross zero at a value, without other poles.

        ``det(-K)`` is that of the board at `own` times ``1 + (share - 1) W(0)``, for a single part:
        it changes its sign there, and so does one pole, if no pole at `own` is at zero.
        """
        ports = self.ports
        if own is None or ports is None or ports.count != 1 or not own.complete:
            return False
        if np.any(np.abs(own.poles) <= APART_FROM_ZERO * own.errors):
            return False
        if not ports.board.circuit.is_linear:
            return False
        share = self._share(value)
        with suppress(EngineError):
            (response,) = ports.exact(0j)[0].real.tolist()
            return bool(abs(1.0 + (share - 1.0) * response) <= BESIDE * abs(share))
        return False

    def _crosses(self, value: float) -> bool | None:
        """Return whether the unstable count changes at a value; None where rounding hides it."""
        counts = list[tuple[int, int]]()
        for side in (1.0 - BESIDE, 1.0 + BESIDE):
            try:
                there = self.poles(value * side)
            except EngineError:
                return None
            if not there.complete:
                return True
            real = there.poles.real
            counts.append((int((real > there.errors).sum()), int((real >= -there.errors).sum())))
        (least, most), (lower, upper) = counts
        if most < lower or upper < least:
            return True
        return False if least == most == lower == upper else None

    def _located(self, low: float, high: float) -> list[float]:
        """Return values on both sides of the edges that the loci show."""
        if self.ports is None:
            return []
        (traced,) = trace_together([LociSearch(self.ports, *self.shares(low, high))])
        if isinstance(traced, EngineError):
            return []
        found = self.at_values(traced)
        places = [*(edge.value for edge in found.edges), *found.near]
        sides = (1.0 - BESIDE, 1.0, 1.0 + BESIDE)
        return [v for each in places for side in sides if low < (v := each * side) < high]


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
    be found; whoever asks certifies it. The edges agree with the poles at `values`, too.
    """

    family: Family
    low: float
    high: float
    found: Poles | None = None
    nearest: bool = False
    values: tuple[float, ...] = ()

    def begun(self) -> Edges | tuple[LociSearch, Poles]:
        """Return the edges by a scan, or the search by loci, and the poles at `own`."""
        family = self.family
        if family.ports is None:
            return self.scanned()
        own = poles(family.ports.board) if self.found is None else self.found
        known = own.complete or own.stable  # else the poles are too few to be counted
        count = own.unstable_count if known else count_unstable(family.ports.board)
        shares = family.shares(self.low, self.high)
        return LociSearch(family.ports, *shares, count), own

    def scanned(self) -> Edges:
        """Return the edges by poles at samples alone."""
        points = 2 + math.ceil(PER_DECADE * math.log10(self.high / self.low))
        values = np.geomspace(self.low, self.high, points).tolist()
        values[0], values[-1] = self.low, self.high
        start = self.family.own if self.nearest else None
        return self.family.scan([*values, *self.values], start=start)

    def ended(self, search: LociSearch, own: Poles, found: Edges | EngineError) -> Edges:
        """Return what the loci found, confirmed."""
        if isinstance(found, EngineError):
            raise found
        return self.family.confirmed(self.family.at_values(found), search.unstable, own)


def edges_together(searches: Sequence[EdgeSearch]) -> list[Edges | TactionError]:
    """Return the edges of each search, or why there are none; see `Family.edges`.

    The loci of all boards are followed together. Where poles do not confirm what they show, a scan
    finds the edges.
    """
    begun = [or_error(EdgeSearch.begun, one) for one in searches]
    loci = [each[0] for each in begun if not isinstance(each, Edges | TactionError)]
    traced = iter(trace_together(loci))
    found, claims = list[Edges | TactionError](), dict[int, EdgeClaim]()
    for k, (one, each) in enumerate(zip(searches, begun, strict=True)):
        if isinstance(each, Edges | TactionError):
            found.append(each)
            continue
        edges = or_error(partial(one.ended, *each), next(traced))
        found.append(edges)
        large = each[0].ports.board.descriptor.is_large
        if isinstance(edges, Edges) and not one.nearest and not large:
            claims[k] = EdgeClaim(edges, one.family.board, one.values, precise=_precise(each[1]))
    counts = _exact_counts([searches[k].family for k in claims])
    claims = {k: replace(claim, count=counts.get(n)) for n, (k, claim) in enumerate(claims.items())}
    for (k, claim), certified in zip(claims.items(), certify(list(claims.values())), strict=True):
        if certified is None and claim.count:
            found[k] = counted_edges(claim)
        else:
            found[k] = or_error(EdgeSearch.scanned, searches[k]) if certified is None else certified
    return found


def _precise(found: Poles) -> bool:
    """Tell whether every pole is known well: then so are the loci, which follow from the modes."""
    return found.complete and bool(np.all(found.errors <= PRECISE * np.abs(found.poles)))


def _exact_counts(families: Sequence[Family]) -> dict[int, ExactCount]:
    """Return the count of unstable poles of each family of a deck over one part, by its place."""
    decks = {
        k: family.ports.board
        for k, family in enumerate(families)
        if family.ports and family.ports.count == 1 and family.ports.board.descriptor.has_branches
    }
    doubled = {k: or_error(families[k].board, 2.0 * families[k].own) for k in decks}
    stamp_boards([each for each in doubled.values() if isinstance(each, LinearBoard)])
    first = {board: characteristic(board.descriptor) for board in dict.fromkeys(decks.values())}
    found = dict[int, ExactCount]()
    for k, board in decks.items():
        other, family = doubled[k], families[k]
        if isinstance(other, LinearBoard):
            count = ExactCount.of(first[board], other, family.own, family.power)
            found |= {k: count} if count else {}
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
