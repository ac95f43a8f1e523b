"""The stability boundary of a sweep over two axes, solved between the points of the grid."""

from __future__ import annotations

import itertools
import math
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import Point, SweepAxis, with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value
from taction.system.array_types import Floats
from taction.system.errors import TactionError
from taction.verification.stability.edges import Edges
from taction.verification.stability.families import EdgeSearch, Family, edges_together
from taction.verification.stability.poles import Poles, or_error, poles_together
from taction.verification.stability.scan import scan
from taction.verification.studies.sweep.plan import Plan

TOLERANCE = 1e-3  # of a crossing's value, relative: less than a line of a picture is wide
SAMPLES = 9  # least number of first evaluations along a line
EVALUATIONS = 8  # of poles for one crossing of this tolerance
SECONDS = 15.0  # of processor time: a boundary that would take longer is left to interpolation

Crossing = tuple[float, float]  # values on the first and on the second axis
Segment = tuple[Crossing, Crossing]
Place = tuple[int, int]  # of a point of the grid
Changes = tuple[tuple[str, Value], ...]  # of the scene, at a point


@dataclass(frozen=True, slots=True)
class Boundary:
    """Where a board becomes unstable: its rightmost pole crosses the imaginary axis.

    Attributes
    ----------
    points : tuple of pairs
        Values on both axes of every crossing along a line of the grid; on a list the place of
        the value.
    segments : tuple of pairs of points
        Neighbouring crossings of one cell of the grid, to be joined by a line. Empty if an axis is
        a list: nothing lies between two of its values.
    unsolved : str
        Why the boundary was not solved, or empty.
    """

    points: tuple[Crossing, ...] = ()
    segments: tuple[Segment, ...] = ()
    unsolved: str = ""


def solve_boundary(plan: Plan, *, seconds: float = SECONDS) -> Boundary:
    """Find where stability ends along the lines of a grid of two axes, as `onset` does.

    Along each line all edges of stability are found, also those of an unstable range that lies
    between two points of the grid.

    Parameters
    ----------
    seconds : float
        Estimated processor time above which nothing is solved.

    Notes
    -----
    The cost is about one evaluation of the poles for every point and axis, and `EVALUATIONS` for
    every crossing.
    """
    across, down = (group[0] for group in plan.groups)
    lines = _GridLines(plan)
    ends = len(across) - 1, len(down) - 1
    lines.poles_at([(0, 0)])  # loads modules
    began = clock.process_time()
    lines.poles_at([(ends[0], 0), (0, ends[1]), ends])
    needed = (clock.process_time() - began) / 3 * 2 * plan.points
    if needed > seconds:
        return Boundary(unsolved=f"solving the boundary would take {needed:.0f} s")
    rows, columns = lines.crossings(0), lines.crossings(1)
    points = [(x, place_of(down, j)) for j, found in rows.items() for x in found]
    points += [(place_of(across, i), y) for i, found in columns.items() for y in found]
    segments: tuple[Segment, ...] = ()
    if rows and columns:
        segments = tuple(_joined(across, down, rows, columns))
    return Boundary(tuple(points), segments)


def by_value(axis: SweepAxis) -> bool:
    """Whether numbers lie between the values of an axis: it is a range, not a list."""
    return axis.key.kind == "real" and axis.scale != "list"


def place_of(axis: SweepAxis, number: int) -> float:
    """Return a value of a range, or the place in a list."""
    return float(axis.values[number]) if by_value(axis) else float(number)


class _GridLines:
    """Edges of stability along the lines of a grid."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        fixed = all(not axis.key.path.startswith("problem.") for axis in plan.axes)
        self.problem = make_problem(plan.scene) if fixed else None
        self.known: dict[Changes, Poles | TactionError] = {}

    def poles_at(self, places: Sequence[Place]) -> list[Poles | TactionError]:
        """Return the poles at points of the grid, or why there are none."""
        numbers = np.ravel_multi_index(np.transpose(places), self.plan.shape).tolist()
        return self._poles([_hashable(self.plan.values_at(number)) for number in numbers])

    def crossings(self, along: int) -> dict[int, list[float]]:
        """Return where stability changes along each line of axis 0 or 1, by the other's place.

        Nothing lies between the values of a list.
        """
        group, rest = self.plan.groups[along], self.plan.groups[1 - along]
        if not by_value(group[0]):
            return {}
        traced, found = dict[int, EdgeSearch](), dict[int, Edges | TactionError]()
        for other in range(len(rest[0])):
            fixed: Point = {axis.key.path: axis.values[other] for axis in rest}
            search = self._loci(group, fixed)
            if search is None:
                found[other] = self._scan(group, fixed)
            else:
                traced[other] = search
        found |= zip(traced, edges_together(list(traced.values())), strict=True)
        return {other: _changing(found[other]) for other in range(len(rest[0]))}

    def _loci(self, group: Sequence[SweepAxis], fixed: Point) -> EdgeSearch | None:
        """Return a search for the edges of a line by the loci of its knob, if it has them."""
        low, high, logarithmic = _range(group[0])
        if not logarithmic or len(group) > 1:
            return None

        def board(value: float) -> Circuit:
            return self._board({**fixed, **_together(group, value)})

        family = Family.over(board, group[0].key.path, math.sqrt(low * high))
        return EdgeSearch(family, low, high) if family.ports else None

    def _scan(self, group: Sequence[SweepAxis], fixed: Point) -> Edges | TactionError:
        *_, logarithmic = _range(group[0])
        values = _denser([float(value) for value in group[0].values], logarithmic=logarithmic)

        def read(some: Sequence[float]) -> list[Poles | TactionError]:
            return self._poles([_hashable({**fixed, **_together(group, value)}) for value in some])

        try:
            return scan(values, read, logarithmic=logarithmic, tolerance=TOLERANCE)
        except TactionError as error:
            return error

    def _board(self, changes: Point) -> Circuit:
        scene = with_values(self.plan.scene, changes)
        return synthesise(scene, self.problem or make_problem(scene))

    def _poles(self, wanted: Sequence[Changes]) -> list[Poles | TactionError]:
        """Return the poles of boards; two lines share each point of the grid."""
        new = [changes for changes in wanted if changes not in self.known]
        found = poles_together(or_error(self._board, dict(changes)) for changes in new)
        self.known |= zip(new, found, strict=True)
        return [self.known[changes] for changes in wanted]


def _hashable(changes: Point) -> Changes:
    return tuple(sorted(changes.items()))


def _range(axis: SweepAxis) -> tuple[float, float, bool]:
    """Return the ends of an axis, and whether the logarithms of its values are evenly spaced."""
    values = [float(value) for value in axis.values]
    return min(values), max(values), axis.scale != "lin" and min(values) > 0.0


def _changing(found: Edges | TactionError) -> list[float]:
    """Return the edges at which stability changes; none on a line without poles."""
    if isinstance(found, TactionError):
        return []
    return [edge.value for edge in found.edges if edge.changes_stability]


def _denser(values: list[float], *, logarithmic: bool) -> list[float]:
    """Return the values with middles between them, until there are `SAMPLES`."""
    found = sorted(values)
    while 1 < len(found) < SAMPLES:
        pairs = list(itertools.pairwise(found))
        middles = [math.sqrt(a * b) if logarithmic else 0.5 * (a + b) for a, b in pairs]
        found = sorted([*found, *middles])
    return found


def _together(group: Sequence[SweepAxis], value: float) -> Point:
    """Return the values of axes that change together, interpolated at a value of the first axis."""
    first = np.array([float(x) for x in group[0].values])
    order = np.argsort(first)
    changes: dict[str, float] = {group[0].key.path: value}
    for axis in group[1:]:
        own = np.array([float(x) for x in axis.values])
        changes[axis.key.path] = float(np.interp(value, first[order], own[order]))
    return changes


def _joined(
    across: SweepAxis,
    down: SweepAxis,
    rows: dict[int, list[float]],
    columns: dict[int, list[float]],
) -> Iterator[Segment]:
    """Join the crossings on the four sides of every cell, the nearest ones with each other."""
    x, y = (_scaled(axis) for axis in (across, down))
    for i, j in itertools.product(range(len(across) - 1), range(len(down) - 1)):
        sides = [(v, place_of(down, k)) for k in (j, j + 1) for v in _within(rows[k], across, i)]
        for k in (i, i + 1):
            sides += [(place_of(across, k), v) for v in _within(columns[k], down, j)]
        if len(sides) in (2, 4):
            yield from _shortest(sides, lambda a, b: math.hypot(x(a[0], b[0]), y(a[1], b[1])))


def _within(found: list[float], axis: SweepAxis, k: int) -> list[float]:
    ends = sorted((float(axis.values[k]), float(axis.values[k + 1])))
    return [value for value in found if ends[0] <= value <= ends[1]]


def _scaled(axis: SweepAxis) -> Callable[[float, float], float]:
    """Return the distance of two values, in parts of the axis."""
    values: Floats = np.array([float(value) for value in axis.values])
    if axis.scale == "lin" or values.min() <= 0.0:
        return lambda a, b: abs(a - b) / float(np.ptp(values))
    reach = math.log(float(values.max() / values.min()))
    return lambda a, b: abs(math.log(a / b)) / reach


def _shortest(
    places: list[Crossing], distance: Callable[[Crossing, Crossing], float]
) -> list[Segment]:
    """Return the pairs of two or four places whose segments are the shortest in sum."""
    first, *rest = places
    if len(rest) == 1:
        return [(first, rest[0])]
    ways = [[(first, rest[k]), (rest[k - 1], rest[k - 2])] for k in range(3)]
    return min(ways, key=lambda way: sum(distance(*segment) for segment in way))
