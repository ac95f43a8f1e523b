"""Boards that differ in one number, and every edge of stability among them.

Where the number only scales equal parts, and the equilibrium stays, the loci of these parts find
every edge from one board (`loci`). They follow from the modes of one board, so poles many decades
apart can blind them. Poles of the boards at the ends of the range, between its edges, and beside
each edge, have bounds of their own: a count that differs from what the edges say is a crossing that
the loci missed. Then, and without loci, poles at samples of the number find the edges (`scan`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from operator import attrgetter

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Knob
from taction.netlist_gen.board.parts import Capacitor, Resistor
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.spice_models.branches import Branch
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError, InputError
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edges, Sample, Scan, sampled, scan
from taction.verification.stability.loci import traced_edges
from taction.verification.stability.poles import Poles, poles
from taction.verification.stability.port_response import PortResponse

Parts = tuple[Capacitor | Resistor, ...]
PER_DECADE = 20  # values of the first grid of a scan
PRECISE = 1e-6  # largest relative bound of a pole of a board whose loci are trusted
BESIDE = (1e-6, 1e-3)  # relative distances of what confirms an edge: the first to do
SCANNED = (1e-9, 1e-6)  # relative distances of samples of a scan from an edge that the loci show
WIDE = 30.0  # largest ratio of neighbouring samples that confirm edges
APART, SAME = 1.01, 1e-9  # of two boards that are compared: ratio of their values, and tolerance
MOVED = 1e-5  # relative change of a value for a sensitivity
LOST = 1e-9  # of the pole: a smaller rate is not known


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
        circuit, families = board.circuit, list[Family]()
        for knob, parts in zip(knobs, scaled_parts(circuit, knobs), strict=True):
            reactive = bool(parts) and isinstance(parts[0], Capacitor)  # it moves no equilibrium
            ports: PortResponse | None = None
            if reactive or (parts and not circuit.has_nonlinear_amplifiers):
                ports = PortResponse.of_parts(board, parts)
            elif not parts and circuit.is_linear and not circuit.scales_arrays(knob):
                ports = PortResponse.of_law(board, knob.name)
            point = board.operating_point if reactive else None
            moved = partial(_moved, circuit, knob.name, point)
            power = -knob.power if parts and not reactive else knob.power
            families.append(cls(moved, circuit.value(knob.name), ports, power))
        return families

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
        start: float | None = None,
    ) -> Scan:
        """Find every edge among `values`, with the poles at samples; see `scan`.

        With samples beside the edges of the loci no edge is too narrow to be found.
        """
        low, high = min(values), max(values)
        traced = self._traced(low, high) if logarithmic else None
        places = [*(edge.value for edge in traced.edges), *traced.near] if traced else []
        sides = (0.0, *(by for distance in SCANNED for by in (-distance, distance)))
        beside = [v for at in places for by in sides if low < (v := at * (1.0 + by)) < high]
        found = scan([*values, *beside], self.poles, logarithmic=logarithmic, start=start)
        return replace(found, traced=traced)

    def _traced(self, low: float, high: float) -> Edges | None:
        """Return the edges that the loci show; None without loci."""
        if self.ports is None:
            return None
        try:
            unstable = poles(self.ports.board).unstable_count
            return traced_edges(self.ports, low, high, unstable, self.own, self.power)
        except EngineError:
            return None


def find_edges(
    family: Family,
    low: float,
    high: float,
    found: Poles | None = None,
    values: Sequence[float] = (),
    *,
    nearest: bool = False,
) -> Edges:
    """Find every edge of a family from `low` to `high` (above zero), by its loci or by a scan.

    `found`: poles at the family's `own` value, if they have been computed before.
    `values`: the edges agree with the poles at these, too.
    `nearest`: the board at `own`, one of the two ends, is stable, and only the edge next to it need
      be found and confirmed.
    InputError, EngineError: no board, no equilibrium, no state-space form, a pole at `own` is on
      the axis, or a large board is not stable there.
    """
    if (ports := family.ports) is not None:
        own = found or poles(ports.board)
        if not (own.complete or own.stable):
            raise EngineError("a large board that is not stable has poles that are not counted")
        traced = traced_edges(ports, low, high, own.unstable_count, family.own, family.power)
        if ports.board.descriptor.is_large and not nearest:
            return traced  # the poles of a large board cost seconds
        if (edges := _confirmed(family, own, traced, values, nearest=nearest)) is not None:
            return edges
    points = 2 + math.ceil(PER_DECADE * math.log10(high / low))
    grid = [low, *np.geomspace(low, high, points)[1:-1].tolist(), high]
    return family.scan([*grid, *values], start=family.own if nearest else None)


def _confirmed(
    family: Family, own: Poles, found: Edges, values: Iterable[float], *, nearest: bool
) -> Edges | None:
    """Return edges that the loci show with their bounds; None where poles do not confirm them.

    `own` are the poles at the family's own value. A sample of which rounding hides the side of a
    pole is a near value. Where every pole is known well, near edges and ends need no samples
    between them.
    """
    low, high = found.low, found.high
    if nearest and found.edges:
        first = found.edges[0 if family.own == low else -1].value
        low, high = (low, first) if family.own == low else (first, high)
    inside = [edge.value for edge in found.edges if low <= edge.value <= high]
    samples = dict[float, Sample]()

    def agrees(value: float) -> bool | None:
        if value not in samples:
            samples[value] = sampled(family.poles, value)
        return samples[value].agrees(found.unstable_at(value))

    precise = own.complete and np.all(own.errors <= PRECISE * np.abs(own.poles))
    every = {low, high, *values, *(at for at in found.near if low <= at <= high)} - {family.own}
    for ends in pairwise(sorted({low, *inside, high})):
        every.update(_between(*ends, first=1.0 if precise else 0.5))
    apart = {v for v in every if all(abs(v / at - 1.0) > BESIDE[-1] for at in inside)}
    near = [value for value in sorted(apart) if agrees(value) is None]
    if any(agrees(value) is False for value in apart):
        return None
    bounds = dict[float, float]()
    for at in inside:
        for by in BESIDE:
            sides = [agrees(at * (1.0 + d)) for d in (-by, by)]
            if False in sides:
                return None
            if all(sides):
                bounds[at] = by * at
                break
        else:
            return None
    edges = (replace(edge, bound=bounds.get(edge.value, math.inf)) for edge in found.edges)
    return replace(found, edges=tuple(edges), near=tuple(near))


def _between(low: float, high: float, first: float) -> Iterator[float]:
    """Yield values between two edges, or ends of a range, that are at most `WIDE` apart.

    The `first` step is a half, so that there is at least one value, or a whole one.
    """
    count = math.ceil(math.log(high / low) / math.log(WIDE))
    steps = (k + first for k in range(count) if k + first < count)
    return (low * (high / low) ** (step / count) for step in steps)


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
    fixed = attrgetter("by_column", "plus", "minus", "sinks")
    matrices = tuple(
        (m.negative.tobytes(), *fixed(m), m.wires and m.wires.resistances) for m in circuit.matrices
    )
    rest = (
        knob.name,
        tuple(circuit.models.items()),
        circuit.opamps,
        matrices,
        tuple((part.card, part.a, part.b) for part, _ in parts),
        tuple(replace(part, value=1.0) for part in circuit.branches),
        tuple(source.node for source in circuit.voltages),
        circuit.supply,
    )
    return rest, np.concatenate([numbers, *arrays])


def sensitivities(
    board: LinearBoard, found: Poles, families: Mapping[str, Family]
) -> dict[str, complex]:
    """Return ``dp / d ln value`` of the rightmost pole p, 1/s, for every knob of parts.

    With ``(p M - K) v = 0`` and ``w (p M - K) = 0`` the pole moves by
    ``w (dK - p dM) v / (w M v)``, where the matrices are not linear in the value by a central
    difference. A rate that is lost in rounding beside the pole is zero.
    """
    if not len(found.poles) or board.descriptor.is_large:
        return {}
    p, point = found.rightmost, board.operating_point
    right, left = pole_vectors(board, p)
    scale = left @ board.matrices.mass @ right
    if not abs(scale) > 0.0:
        return {}
    rates = {}
    for name, family in families.items():
        if family.ports is not None and not board.circuit.knob(name).moves:
            rates[name] = complex(family.power * family.ports.rate(left, right, p) / scale)
            continue
        both = []
        for factor in (1.0 + MOVED, 1.0 - MOVED):
            moved = board.circuit.turned(name, board.circuit.value(name) * factor)
            there = LinearBoard(moved, point=point).matrices
            both.append(left @ (there.stiffness - p * there.mass) @ right)
        rates[name] = complex((both[0] - both[1]) / (2.0 * MOVED * scale))
    return {name: rate if abs(rate) > LOST * abs(p) else 0j for name, rate in rates.items()}


def pole_vectors(board: LinearBoard, p: complex) -> tuple[Complexes, Complexes]:
    """Return the right and the left null vector of ``p M - K``: of its least singular value."""
    X = p * board.matrices.mass - board.matrices.stiffness
    rows = np.abs(X).max(axis=1, keepdims=True)
    rows[rows == 0.0] = 1.0
    columns = np.abs(X / rows).max(axis=0)
    columns[columns == 0.0] = 1.0
    U, _, V = np.linalg.svd(X / rows / columns)
    return V[-1].conj() / columns, U[:, -1].conj() / rows[:, 0]
