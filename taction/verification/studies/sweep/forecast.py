"""How long a sweep will take: the forecast before it begins, and the time that is left."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.axes import ENGINE, with_values
from taction.system.array_types import Bools, Floats, Indices
from taction.system.errors import TactionError
from taction.system.progress import Clock, duration
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.sweep.hybrid import has_order, next_to_the_boundary, sample
from taction.verification.studies.sweep.plan import Plan
from taction.verification.verdict.design import design_board
from taction.verification.verdict.simulation import SLOWER
from taction.verification.verdict.transient_plan import plan_transient

COARSE = 0.06  # of the points form the coarse grid
FEWEST, MOST = 4, 42  # points of the coarse grid
ENOUGH = 12  # of them where no steps of ngspice count
DEAR = 20.0  # times the time of a plan: a longer run of ngspice is planned
MOST_DEAR = 60  # further points that are planned
START = 0.008  # s: a run of ngspice without its steps
STATE_SPACE = {"small": 1.4, "large": 6.0, "nonlinear": 10.0}
NGSPICE = {"small": 3.5, "large": 2.0, "nonlinear": 13.0}
"""Time of a point without the steps of ngspice, over the time to design its board, by the kind of
the board (measured for N = 7 to 128, with 16 points in a call)."""
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
    nodes = min(max(int(COARSE * plan.points), FEWEST), MOST if simulated else ENOUGH)
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


INTERVAL = 0.2  # s between two estimates


class RemainingTime:
    """Follows the points of a sweep and estimates the time until all of them are computed.

    The processes take the points in the order in which the sweep submits them. A point that is done
    calibrates the forecast of its engine by the time that it took; a point that began before any
    other was done does not, since the processes start in that time.

    Parameters
    ----------
    forecast : CostForecast
        Estimated processor time of every point.
    left : mapping of str to ndarray (P,)
        The points to compute, by engine.
    processes : callable
        Number of processes at work.
    clock : callable, optional
        Returns the time, s.
    """

    def __init__(
        self,
        forecast: CostForecast,
        left: Mapping[str, Bools],
        processes: Callable[[], int],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._forecast, self._processes, self._clock = forecast, processes, clock
        self._left = {engine: np.array(places) for engine, places in left.items()}
        self._waiting: deque[tuple[str, int]] = deque()
        self._running: dict[tuple[str, int], tuple[float, bool]] = {}  # start; if it calibrates
        self._taken = dict.fromkeys(left, 0.0)
        self._expected = dict.fromkeys(left, 0.0)
        self._warm = False
        self._last = (-INTERVAL, 0.0)

    def replace(self, engine: str, left: Bools) -> None:
        """Set the points that are left for `engine`, (P,)."""
        self._left[engine] = np.array(left)

    def submit(self, engine: str, place: int) -> None:
        """Count a point that waits for a process."""
        self._waiting.append((engine, place))
        self._begin()

    def finish(self, engine: str, place: int) -> None:
        """Count a point that is done, or that needs no computation."""
        self._left[engine][place] = False
        if (engine, place) in self._waiting:
            self._waiting.remove((engine, place))
        elif (engine, place) in self._running:
            start, calibrates = self._running.pop((engine, place))
            if calibrates:
                self._taken[engine] += self._clock() - start
                self._expected[engine] += float(self._forecast.seconds[engine][place])
            self._warm = True
            self._begin()

    def seconds(self) -> float:
        """Return the remaining time, s."""
        now = self._clock()
        then, seconds = self._last
        if now - then < INTERVAL:
            return max(seconds - (now - then), 0.0)
        total, longest = 0.0, 0.0
        for engine, left in self._left.items():
            rest = self._ratio(engine) * self._forecast.seconds[engine] * left
            for (other, place), (start, _) in self._running.items():
                if other == engine:
                    rest[place] = max(rest[place] - (now - start), 0.0)
            total, longest = total + float(rest.sum()), max(longest, float(rest.max(initial=0.0)))
        seconds = max(total / max(self._processes(), 1), longest)
        self._last = (now, seconds)
        return seconds

    def _begin(self) -> None:
        """Give waiting points to free processes."""
        while self._waiting and len(self._running) < max(self._processes(), 1):
            self._running[self._waiting.popleft()] = (self._clock(), self._warm)

    def _ratio(self, engine: str) -> float:
        """Return wall time over forecast, of `engine` if it has results, else of all engines."""
        expected, taken = self._expected[engine], self._taken[engine]
        if not expected:
            expected, taken = sum(self._expected.values()), sum(self._taken.values())
        return taken / expected if expected else self._forecast.slowness


LONG = 10.0  # s: another engine is proposed for a longer sweep
FASTER = 20.0  # times as fast: the state-space engine is proposed
SLOW = 300.0  # s for ngspice at every point: the hybrid engine is proposed
HYBRID = "--engine hybrid, ngspice only at the decisive points"


def announcement(
    plan: Plan, forecast: CostForecast, left: Mapping[str, Bools], stored: int, workers: Workers
) -> str:
    """Return the line before a sweep.

    Parameters
    ----------
    left : mapping of str to ndarray (P,)
        The points to compute, by engine; of a hybrid sweep the expected points of ngspice.
    stored : int
        Number of points that need no computation.
    """
    text = "1 point" if plan.total == 1 else f"{plan.total} points"
    if plan.hybrid:
        text += f" and ngspice at about {int(left['ngspice'].sum())} of them"
    if stored:
        text += f", {stored} results are stored"
    processes = workers.processes()
    where = "1 process" if processes == 1 else f"{processes} processes"
    seconds = wall_time(forecast, left, workers)
    text += f": about {duration(seconds)} in {where}"
    if "ngspice" not in plan.engines:
        return text
    every = np.ones(plan.points, dtype=np.bool_)
    exact = wall_time(forecast, {"statespace": every}, workers)
    if seconds >= max(LONG, FASTER * exact):
        text += f"; --engine statespace: about {duration(exact)}"
    if not plan.hybrid and wall_time(forecast, {"ngspice": left["ngspice"]}, workers) > SLOW:
        both = {"statespace": every, "ngspice": forecast.confirmed(plan)}
        text += f"; {HYBRID}: about {duration(wall_time(forecast, both, workers))}"
    return text


def wall_time(forecast: CostForecast, places: Mapping[str, Bools], workers: Workers) -> float:
    """Return the estimated wall time of the points `places` by engine, s.

    One point is computed by one process, so the time is at least that of the dearest point.
    """
    costs = [forecast.seconds[engine][marked] for engine, marked in places.items()]
    total = sum(float(cost.sum()) for cost in costs)
    longest = max(float(cost.max(initial=0.0)) for cost in costs)
    processes = max(workers.processes(), 1)
    return forecast.slowness * (workers.start_up + max(total / processes, longest))
