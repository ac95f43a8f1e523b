"""Boards that differ in one number.

Where the number only scales equal parts, and the equilibrium stays, the loci of these parts find
every edge of stability from one board (`loci`). Otherwise, and where poles do not confirm the edges
(`edge_search`), poles at samples of the number find them (`scan`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
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
from taction.system.errors import EngineError, InputError
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edges, Scan
from taction.verification.stability.loci import LociSearch
from taction.verification.stability.poles import Poles, brief_poles, or_error, poles
from taction.verification.stability.port_response import PortResponse
from taction.verification.stability.scan import scan

Parts = tuple[Capacitor | Resistor, ...]
BESIDE = (1e-9, 1e-6)  # relative distances of samples from an edge that the loci show
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

    def scan(
        self,
        values: Sequence[float],
        *,
        logarithmic: bool = True,
        fine: bool = True,
        start: float | None = None,
    ) -> Scan:
        """Find every edge among `values`, with the poles at samples; see `scan`.

        With samples beside the edges of the loci no edge is too narrow to be found. The poles are
        those of `brief_poles`: eigenvalues where these leave no side open.
        """
        beside = self._beside_edges(min(values), max(values)) if logarithmic else []
        return scan(
            [*values, *beside],
            partial(or_error, lambda value: brief_poles(self.board(value))),
            logarithmic=logarithmic,
            fine=fine,
            start=start,
        )

    def _beside_edges(self, low: float, high: float) -> list[float]:
        """Return values on both sides of the edges that the loci show."""
        if self.ports is None:
            return []
        try:
            found = self.at_values(LociSearch(self.ports, *self.shares(low, high)).edges())
        except EngineError:
            return []
        places = [*(edge.value for edge in found.edges), *found.near]
        sides = (0.0, *(by for distance in BESIDE for by in (-distance, distance)))
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
