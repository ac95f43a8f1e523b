"""Boards that differ in one number, and every edge of stability among them.

Where the number only scales equal parts, and the equilibrium stays, the loci of these parts find
every edge from one board (`loci`). Otherwise poles at samples of the number find them (`scan`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Capacitor, Circuit, Knob
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.table import topology_of
from taction.system.errors import EngineError, InputError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.edges import Edges, Scan
from taction.verification.stability.loci import LawResponse, PortResponse, trace_loci
from taction.verification.stability.poles import Poles, count_unstable, poles
from taction.verification.stability.scan import TOLERANCE, scan

PER_DECADE = 20  # values of the first grid of a scan
BESIDE = 1e-6  # relative distance of the samples beside an edge of the loci
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
        Of the number, to which the values of these parts are proportional.
    """

    board: Callable[[float], LinearBoard]
    own: float = 1.0
    ports: PortResponse | None = None
    power: float = 1.0

    @classmethod
    def of(cls, board: LinearBoard, knob: Knob) -> Family:
        """Return the boards that differ from `board` in one of its knobs."""
        circuit, parts = board.circuit, board.circuit.parts_of(knob)
        reactive = bool(parts) and isinstance(parts[0], Capacitor)
        point = board.operating_point if reactive else None  # no capacitor moves the equilibrium

        def moved(value: float) -> LinearBoard:
            return LinearBoard(circuit.turned(knob.name, value), point=point)

        ports: PortResponse | None = None
        if reactive or (parts and not circuit.has_nonlinear_amplifiers):
            ports = PortResponse(board, parts)
        elif not parts and circuit.is_linear:
            ports = LawResponse.of(board, knob.name)
        return cls(moved, circuit.value(knob.name), ports, knob.power)

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
            return cls(board, own, cls.of(middle, alone[0]).ports, alone[0].power)
        except (InputError, EngineError):
            return cls(board)

    def poles(self, value: float) -> Poles:
        """Return the poles at a value."""
        return poles(self.board(value))

    def edges(self, low: float, high: float, found: Poles | None = None) -> Edges:
        """Find every edge from `low` to `high` (above zero); `found`: poles at `own`.

        Raises
        ------
        InputError, EngineError
            No board, no equilibrium, no state-space form, or a pole at `own` is on the axis.

        Notes
        -----
        Costs the loci, or a scan: the poles of `PER_DECADE` boards per decade, and more.
        """
        if self.ports is not None:
            own = poles(self.ports.board) if found is None else found
            known = own.complete or own.stable  # else the poles are too few to be counted
            count = own.unstable_count if known else count_unstable(self.ports.board)
            return self._confirmed(self._loci(self.ports, low, high, count), count)
        points = 2 + math.ceil(PER_DECADE * math.log10(high / low))
        return self.scan(np.geomspace(low, high, points).tolist())

    def scan(
        self,
        values: Sequence[float],
        *,
        logarithmic: bool = True,
        tolerance: float = TOLERANCE,
        fine: bool = True,
    ) -> Scan:
        """Find every edge among `values`, with the poles at samples; see `scan`.

        With samples beside the edges of the loci no edge is too narrow to be found.
        """
        located = self._located(min(values), max(values)) if logarithmic else []
        everything = [*values, *located]
        return scan(self.poles, everything, logarithmic=logarithmic, tolerance=tolerance, fine=fine)

    def count(self, value: float, edges: Edges) -> int:
        """Count the unstable poles at a value by a winding number, without poles."""
        return edges.unstable_at(value) if self.ports else count_unstable(self.board(value))

    def _loci(self, ports: PortResponse, low: float, high: float, unstable: int) -> Edges:
        own, power = self.own, self.power if ports.proportional else -self.power
        if power == 1.0:
            found = trace_loci(ports, low / own, high / own, unstable)
            return found.mapped(lambda share: own * share)
        if power == -1.0:
            found = trace_loci(ports, own / high, own / low, unstable)
            return found.mapped(lambda share: own / share)
        first, last = sorted((value / own) ** power for value in (low, high))
        found = trace_loci(ports, first, last, unstable)
        return found.mapped(lambda share: own * share ** (1.0 / power))

    def _confirmed(self, found: Edges, unstable: int) -> Edges:
        """Return the edges without those at which no real pole crosses; `unstable` is of `own`.

        A pole that stays at zero, such as that of a loop of coils, hides a locus there. An edge
        that rounding hides stays, and its value comes to the near ones.
        """
        near, changes = list(found.near), list[tuple[float, float, int]]()
        for edge in found.edges:
            crosses = True if edge.frequency else self._crosses(edge.value)
            if crosses is None:
                near.append(edge.value)
            if crosses is not False:
                changes.append((edge.value, edge.frequency, edge.above - edge.below))
        if len(changes) == len(found.edges) and len(near) == len(found.near):
            return found
        return Edges.counted((found.low, found.high), changes, near, (self.own, unstable))

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
        try:
            found = self._loci(self.ports, low, high, 0)
        except EngineError:
            return []
        places = [*(edge.value for edge in found.edges), *found.near]
        sides = (1.0 - BESIDE, 1.0, 1.0 + BESIDE)
        return [v for each in places for side in sides if low < (v := each * side) < high]


def _follows(knob: Knob, first: Circuit, second: Circuit) -> bool:
    """Tell whether a knob alone leads from one board to another, without a series that rounds."""
    value = second.value(knob.name)
    if abs(value / (APART * first.value(knob.name)) - 1.0) > SAME:
        return False
    moved = first.turned(knob.name, value)
    values, others = (
        np.array([*(p.ohms for p in c.resistors), *(p.farads for p in c.capacitors),
                  *(e for m in c.matrices for e in m.ohms.ravel().tolist())])
        for c in (moved, second)
    )  # fmt: skip
    same = values.shape == others.shape and moved.models == second.models
    return same and bool(np.allclose(values, others, rtol=SAME, atol=0.0))


def unrounded(scene: Scene, key: str) -> dict[str, Value]:
    """Return the keys of a scene with which no series rounds the parts of a knob."""
    knobs = topology_of(scene).knobs(scene)
    return {knob.series: "exact" for knob in knobs if knob.key == key and knob.series}


def all_but_a_knob(circuit: Circuit, knob: Knob) -> Hashable:
    """Return what decides a linear board's poles, with the sizes of a knob's parts over its value.

    Boards with equal keys differ in nothing but the value of the knob.
    """
    names, own = circuit.named(knob.role), circuit.value(knob.name)
    matrices = [
        (m.ohms.tobytes(), m.negative.tobytes(), m.by_column, m.plus, m.minus, m.sinks)
        for m in circuit.matrices
    ]
    return (
        knob.name,
        tuple(circuit.models.items()),
        circuit.opamps,
        tuple(matrices),
        tuple(
            replace(part, ohms=part.ohms / own) if part.card in names else part
            for part in circuit.resistors
        ),
        tuple(
            replace(part, farads=part.farads / own) if part.card in names else part
            for part in circuit.capacitors
        ),
        tuple(
            replace(part, value=part.value / own) if part.card in names else part
            for part in circuit.branches
        ),
        tuple(source.node for source in circuit.voltages),
        circuit.supply,
    )
