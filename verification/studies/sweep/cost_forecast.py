"""Forecast of the processor time of every point of a sweep, from the plans of a few points.

The number of steps of ngspice grows without limit towards the stability boundary, since the longer
a mode rings, the longer is the record. So two smooth quantities are interpolated over the grid: the
growth rate of the rightmost pole, and the time of the steps times this rate. The points of a coarse
grid are planned, then those that are dear according to the interpolation.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.axes import with_values
from taction.system.array_types import Bools, Floats, Indices
from taction.system.errors import TactionError
from taction.verification.studies.sweep.hybrid import has_order, next_to_the_boundary, sample
from taction.verification.studies.sweep.plan import ENGINE, Plan
from taction.verification.verdict.design import design_board
from taction.verification.verdict.progress import Clock
from taction.verification.verdict.simulation import SLOWER
from taction.verification.verdict.transient_plan import plan_transient

COARSE = 0.06  # of the points form the coarse grid
FEWEST, MOST = 4, 42  # points of the coarse grid
DEAR = 20.0  # times the time of a plan: a longer run of ngspice is planned
MOST_DEAR = 60  # further points that are planned
START = 0.008  # s: a run of ngspice without its steps
STATE_SPACE = {"small": 3.5, "large": 6.0, "nonlinear": 60.0}
NGSPICE = {"small": 4.0, "large": 2.0, "nonlinear": 45.0}
"""Time of a point without the steps of ngspice, over the time to design its board, by the kind of
the board (measured for N = 7 to 128)."""
TINY = 1e-9  # s, 1/s: in the place of 0 in a logarithm or a quotient
NO_PLAN = (TactionError, ArithmeticError, ValueError)  # errors of one point


@dataclass(frozen=True, slots=True, eq=False)
class CostForecast:
    """Estimated processor time of the points, in the order of the grid.

    Attributes
    ----------
    seconds : dict of str to ndarray (P,)
        By engine, s; 0 for a point that cannot be planned, which is an error at once.
    stable : ndarray (P,)
        Whether the board is stable, interpolated.
    slowness : float
        Wall time over processor time on this machine, with its other work.
    """

    seconds: dict[str, Floats]
    stable: Bools
    slowness: float

    def confirmed(self, plan: Plan) -> Bools:
        """Mark the points that ngspice will probably confirm, (P,), without the extremes."""
        signs = np.where(self.stable, 1, -1).reshape(plan.shape)
        marked = next_to_the_boundary(signs, plan).ravel()
        marked[sample(plan.points)] = True
        return marked


def forecast_costs(plan: Plan) -> CostForecast:
    """Forecast the cost of every point of `plan` by its engines.

    An engine of another package is taken for as slow as ngspice, until its first points have ended.
    """
    simulated = plan.engines != ("statespace",)
    nodes = min(max(int(COARSE * plan.points), FEWEST), MOST) if simulated else FEWEST
    places, weights, cells = _coarse_grid(plan, nodes)
    _Planner(plan).add(int(places.flat[0]))  # loads modules
    planner = _Planner(plan)
    for place in places.ravel().tolist():
        planner.add(place)
    grid = _interpolated(planner.rows_at(places), weights)
    if simulated:
        _plan_dear_points(plan, planner, grid, cells)
    steps, timeout = _steps(grid), plan.scene.analysis.timeout
    steps = np.where(steps > SLOWER * timeout, 0.0, np.minimum(steps, timeout))
    seconds = {"ngspice": np.exp(grid[:, 1]) + steps, "statespace": np.exp(grid[:, 0])}
    for column in seconds.values():
        column[planner.failed] = 0.0
    seconds |= {engine: seconds["ngspice"] for engine in plan.engines if engine not in seconds}
    return CostForecast(seconds, grid[:, 3] < 0.0, planner.slowness)


class _Planner:
    """Plans points of a sweep and measures the time that this takes.

    Attributes
    ----------
    rows : dict of int to ndarray (4,)
        By place: the logarithms of the time of the state-space engine, of the time of ngspice
        without its steps, and of the time of these steps times the growth rate; the growth rate.
    failed : list of int
        Places that cannot be planned.
    """

    def __init__(self, plan: Plan) -> None:
        self.rows: dict[int, Floats] = {}
        self.failed: list[int] = []
        self._plan = plan
        self._wall = self._processor = TINY

    @property
    def slowness(self) -> float:
        """Wall time over processor time."""
        return max(self._wall / self._processor, 1.0)

    @property
    def seconds_per_plan(self) -> float:
        """Processor time of a plan, s."""
        return self._processor / max(len(self.rows) + len(self.failed), 1)

    def add(self, place: int) -> None:
        """Plan the point at `place`."""
        wall, processor = time.perf_counter(), time.process_time()
        try:
            self.rows[place] = self._row(place)
        except NO_PLAN:
            self.failed.append(place)
        self._wall += time.perf_counter() - wall
        self._processor += time.process_time() - processor

    def rows_at(self, places: Indices) -> Floats:
        """Return the rows at `places`, shape (*places.shape, 4); their mean where a plan failed."""
        mean = np.mean([*self.rows.values()] or [np.full(4, math.log(TINY))], axis=0)
        rows = [self.rows.get(place, mean) for place in places.ravel().tolist()]
        return np.array(rows).reshape(*places.shape, 4)

    def enter(self, grid: Floats) -> None:
        """Write the rows into `grid` (P, 4)."""
        for place, row in self.rows.items():
            grid[place] = row

    def _row(self, place: int) -> Floats:
        scene = with_values(self._plan.scene, self._plan.values_at(place) | {ENGINE: "statespace"})
        start = time.process_time()
        design = design_board(scene, Clock(lambda stage: None))
        seconds = time.process_time() - start
        board, stable = design.board, design.poles.known_stable
        run = plan_transient(design.scene, board, design.scales, stable=stable)
        kind = "large" if board.descriptor.is_large else "small"
        kind = kind if board.circuit.is_linear else "nonlinear"
        growth = float(design.poles.rightmost.real)
        times = (
            STATE_SPACE[kind] * seconds,
            NGSPICE[kind] * seconds + START,
            max(run.seconds, TINY) * max(abs(growth), TINY),
        )
        return np.array([*np.log(times), growth])


def _plan_dear_points(plan: Plan, planner: _Planner, grid: Floats, cells: Sequence[float]) -> None:
    """Plan the points with a long run of ngspice and those next to the stability boundary.

    Each of them corrects `grid` (P, 4) around itself; the correction fades out over a cell of the
    coarse grid. `cells` are the sizes of a cell.
    """
    for _ in range(MOST_DEAR):
        steps, signs = _steps(grid), np.sign(grid[:, 3]).reshape(plan.shape)
        steps[next_to_the_boundary(signs, plan).ravel()] += DEAR * planner.seconds_per_plan
        steps[[*planner.rows, *planner.failed]] = 0.0
        dearest = int(np.argmax(steps))
        if steps[dearest] < DEAR * planner.seconds_per_plan:
            return
        planner.add(dearest)
        if dearest in planner.rows:
            at = np.unravel_index(dearest, plan.shape)
            weight = np.ones(1)
            for size, place, cell in zip(plan.shape, at, cells, strict=True):
                fading = np.clip(1.0 - np.abs(np.arange(size) - place) / cell, 0.0, 1.0)
                weight = np.multiply.outer(weight, fading)
            grid += weight.reshape(-1, 1) * (planner.rows[dearest] - grid[dearest])
            planner.enter(grid)


def _coarse_grid(plan: Plan, nodes: int) -> tuple[Indices, list[Floats], list[float]]:
    """Return the places of at most `nodes` points, and the weights and cells of the interpolation.

    An axis has weights of the shape (its values, its nodes), and its cell is the distance of two
    nodes. An axis of words has all its values as nodes if that is possible, since nothing can be
    interpolated between words.
    """
    counts = [1] * len(plan.shape)
    ordered = [has_order(group) for group in plan.groups]
    while True:
        free = [k for k, size in enumerate(plan.shape) if counts[k] < size]
        free = [k for k in free if math.prod(counts) // counts[k] * (counts[k] + 1) <= nodes]
        if not free:
            break
        counts[max(free, key=lambda k: (not ordered[k], plan.shape[k] / counts[k]))] += 1
    axes, weights, cells = [], [], []
    for size, count, numbers in zip(plan.shape, counts, ordered, strict=True):
        ends = (0, size - 1) if count > 1 else ((size - 1) // 2,) * 2
        places = np.unique(np.round(np.linspace(*ends, count)).astype(np.intp))
        axes.append(places)
        cells.append((size - 1) / (count - 1) if count > 1 else float(size))
        every = np.arange(size)
        if numbers:
            columns = [np.interp(every, places, unit) for unit in np.eye(len(places))]
            weights.append(np.transpose(columns))
        else:
            nearest = np.abs(every[:, None] - places).argmin(axis=1)
            weights.append(np.eye(len(places))[nearest])
    grid = np.meshgrid(*axes, indexing="ij")
    return np.asarray(np.ravel_multi_index(grid, plan.shape)), weights, cells


def _interpolated(rows: Floats, weights: Sequence[Floats]) -> Floats:
    """Interpolate `rows` (*nodes, 4) linearly along every axis; return (P, 4)."""
    for axis, weight in enumerate(weights):
        rows = np.moveaxis(np.tensordot(weight, rows, (1, axis)), 0, axis)
    return np.ascontiguousarray(rows.reshape(-1, rows.shape[-1]))


def _steps(grid: Floats) -> Floats:
    """Return the time of the steps of ngspice from rows (P, 4) of `_Planner`, s."""
    return np.asarray(np.exp(grid[:, 2]) / np.maximum(np.abs(grid[:, 3]), TINY))
