"""The paper's CONSOLE step: the design with the least settling time under a limit on overshoot.

The state-space engine simulates every candidate; the solution that the board computes does not
change, because lambda is constant (R follows). Settling time jumps where a ringing peak crosses the
band, so the search uses no gradient: a grid, then Nelder and Mead's simplex from its best points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from netlist_gen.board.synthesis import synthesise
from netlist_gen.overrides.axes import with_values
from netlist_gen.overrides.keys import find_key, own_value
from netlist_gen.problem.inverse_problem import InverseProblem, make_problem
from netlist_gen.scene.scene import ExcursionCheck, Scene, StabilityCheck
from spice_models.array_types import Floats
from spice_models.errors import Complaint, EngineError, InputError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients.exact import simulate
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from verification.pipeline.recording import measure_outputs
from verification.pipeline.transient_plan import plan_transient
from verification.small_signal.margin import capacitance_margin
from verification.small_signal.time_scales import time_scales

GRID = {1: 25, 2: 9, 3: 5}  # points of each parameter, by the number of parameters
REACH = 20.0  # the grid spans the scene's value divided and multiplied by this factor
OVERSHOOT = 0.05  # default limit
STARTS = 3  # points of the grid from which a simplex starts
EVALUATIONS = 40  # of one simplex
POINTS_PER_PERIOD = 40.0
MAX_RECORD = 100_000  # points of a candidate's record; a longer record is no good design
RESERVE = 0.99  # of the overshoot limit: the verification adds the simulator's error
# Keys that change neither the solution nor the starting point if lambda is constant.
SAME_ANSWER = {"design.gain", "design.capacitance", "design.unit_conductance"}
INFEASIBLE = 1e6  # added to the objective where a constraint is broken


@dataclass(frozen=True, slots=True)
class Candidate:
    """One design of the search."""

    values: dict[str, float]  # by dotted path
    settling_time: float  # s, the longer value of a fragile reading; infinite if it never settles
    overshoot: float  # fraction of the step amplitude; infinite for an unstable board
    stable: bool  # with the requested margin


@dataclass(frozen=True, slots=True)
class Tuning:
    """Result of a search."""

    before: Candidate  # the design of the scene
    after: Candidate  # the best design within the limits
    scene: Scene  # with the best design, and the limits as checks
    frontier: tuple[Candidate, ...]  # no candidate has both less overshoot and less settling time
    tried: int  # candidates evaluated
    overshoot_limit: float
    margin: float


def tune(
    scene: Scene,
    keys: Iterable[str] = ("gain",),
    *,
    overshoot: float | None = None,
    margin: float | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> Tuning:
    """Search for the least settling time over `keys`.

    Parameters
    ----------
    keys : iterable of str
        One to three numeric keys of the scene's design.
    overshoot : float, optional
        Limit, fraction of the step amplitude; by default the scene's check, else `OVERSHOOT`.
    margin : float, optional
        Factor by which C may shrink; by default the scene's check.

    Raises
    ------
    InputError
        A key is unknown or not of the design, there are no keys or too many, or the design of the
        scene cannot be built.
    EngineError
        No candidate keeps the limits.
    """
    paths = _paths(scene, keys)
    check = scene.checks.overshoot
    limit = overshoot or (OVERSHOOT if check is None else check.max)
    search = _Search(scene, paths, limit, margin or scene.checks.stability.margin)
    centre = np.log([_scene_value(scene, path) for path in paths])
    before = search.evaluate(centre)
    offsets = np.linspace(-math.log(REACH), math.log(REACH), GRID[len(paths)])
    grid = [centre + np.array(offset) for offset in product(offsets, repeat=len(paths))]
    for number, point in enumerate(grid, 1):
        progress(f"grid {number} of {len(grid)}")
        search.evaluate(point)
    for number, start in enumerate(search.best(STARTS), 1):
        progress(f"simplex {number} of {STARTS}")
        search.descend(start, centre, float(offsets[1] - offsets[0]))
    after = search.best(1)[0]
    if search.objective(after) >= INFEASIBLE:
        raise search.no_design()
    return Tuning(
        before=before,
        after=after,
        scene=search.tuned_scene(after),
        frontier=_frontier(search.candidates),
        tried=len(search.candidates),
        overshoot_limit=limit,
        margin=search.margin,
    )


def _paths(scene: Scene, keys: Iterable[str]) -> list[str]:
    paths = [find_key(scene, key).path for key in keys]
    if not 1 <= len(set(paths)) == len(paths) <= max(GRID):
        text = f"give one to {max(GRID)} different keys"
        raise InputError("--over", Complaint("keys", repr(",".join(paths)), text))
    for path in paths:
        if not path.startswith("design."):
            text = "only the design can be tuned, such as gain, capacitance or unit_conductance"
            raise InputError("--over", Complaint(path, "", text))
    return paths


def _scene_value(scene: Scene, path: str) -> float:
    key = find_key(scene, path)
    value = own_value(scene, key) if key.kind == "real" else None
    if value is None or not 0 < value < math.inf:
        text = "the scene has no value above zero of this key, from which the search could start"
        raise InputError("--over", Complaint(path, repr(value), text))
    return value


def _frontier(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Return the Pareto-optimal candidates, by growing overshoot."""
    frontier: list[Candidate] = []
    settling = [c for c in candidates if c.stable and math.isfinite(c.settling_time)]
    for candidate in sorted(settling, key=lambda c: (c.overshoot, c.settling_time)):
        if not frontier or candidate.settling_time < frontier[-1].settling_time:
            frontier.append(candidate)
    return tuple(frontier)


class _Search:
    """Candidates of one search, each simulated once."""

    def __init__(self, scene: Scene, paths: list[str], overshoot: float, margin: float) -> None:
        changes = {"points_per_period": POINTS_PER_PERIOD, "stop": "auto"}
        analysis = scene.analysis.model_copy(update=changes)
        self.base = scene.model_copy(update={"analysis": analysis})
        self.original, self.paths = scene, paths
        self.overshoot, self.margin = overshoot, margin
        self.problem: InverseProblem = make_problem(scene)
        self.lam = ideal_network(self.problem, scene).lam
        self.candidates: list[Candidate] = []
        self._ideal: IdealAnswer | None = None

    def scene_at(self, values: dict[str, float], base: Scene) -> Scene:
        """Return `base` with `values` and the same lambda."""
        constant = {} if "design.resistance" in values else {"design.lambda": self.lam}
        return with_values(base, {**constant, **values})

    def tuned_scene(self, candidate: Candidate) -> Scene:
        """Return the original scene with the design of `candidate` and the limits as checks."""
        limits: dict[str, Any] = {"overshoot": ExcursionCheck(max=self.overshoot)}
        limits |= {"stability": StabilityCheck(margin=self.margin)}
        checks = self.original.checks.model_copy(update=limits)
        return self.scene_at(candidate.values, self.original.model_copy(update={"checks": checks}))

    def objective(self, candidate: Candidate) -> float:
        """Return ln(settling time), plus a penalty that grows with excess overshoot."""
        if not candidate.stable or not math.isfinite(candidate.settling_time):
            return 2 * INFEASIBLE
        excess = max(candidate.overshoot - RESERVE * self.overshoot, 0.0)
        return math.log(candidate.settling_time) + (INFEASIBLE * (1 + excess) if excess else 0.0)

    def best(self, count: int) -> list[Candidate]:
        """Return the best candidates so far."""
        return sorted(self.candidates, key=self.objective)[:count]

    def no_design(self) -> EngineError:
        """Return the error that no candidate keeps the limits, with the least overshoot."""
        least = min((c.overshoot for c in self.candidates), default=math.inf)
        reached = f"the least overshoot of them is {100 * least:.3g} %"
        return EngineError(
            f"no design within a factor of {REACH:g} keeps an overshoot of"
            f" {100 * self.overshoot:g} % and a margin of {self.margin:g} in C; tried"
            f" {len(self.candidates)}, {reached if math.isfinite(least) else 'none has the margin'}"
            ". Loosen a limit, or tune another key, such as capacitance"
        )

    def evaluate(self, point: Floats) -> Candidate:
        """Simulate the design with the logarithmic parameter values `point`."""
        values = dict(zip(self.paths, np.exp(point).tolist(), strict=True))
        try:
            settling, overshoot, stable = self._measure(self.scene_at(values, self.base))
        except (EngineError, InputError):  # the board has no state space or cannot be built
            if not self.candidates:
                raise
            settling, overshoot, stable = math.inf, math.inf, False
        candidate = Candidate(values, settling, overshoot, stable)
        self.candidates.append(candidate)
        return candidate

    def descend(self, start: Candidate, centre: Floats, spacing: float) -> None:
        """Run a simplex from `start` within `REACH` of `centre`; the grid has this `spacing`."""
        from scipy.optimize import minimize

        x0 = np.log([start.values[path] for path in self.paths])
        simplex = np.vstack([x0, x0 + 0.5 * spacing * np.eye(len(x0))])
        options: Any = {"initial_simplex": simplex, "maxfev": EVALUATIONS}
        options |= {"xatol": 1e-3, "fatol": 1e-4}

        def objective(point: Floats) -> float:
            reach = math.log(REACH)
            return self.objective(self.evaluate(np.clip(point, centre - reach, centre + reach)))

        minimize(objective, x0.tolist(), method="Nelder-Mead", options=options)

    def _measure(self, scene: Scene) -> tuple[float, float, bool]:
        board = LinearBoard(synthesise(scene, self.problem))
        scales = time_scales(board, initial=scene.analysis.initial)
        if not np.all(scales.poles.real < 0):
            return math.inf, math.inf, False
        if self.margin > 1:
            found = capacitance_margin(board, self.margin)
            if found.doubt or found.factor - found.uncertainty < self.margin:
                return math.inf, math.inf, False
        plan = plan_transient(scene, board, scales, "statespace")
        transient, instants = plan.transient, plan.instants(board)
        if instants is None or len(instants) > MAX_RECORD:
            return math.inf, math.inf, True
        waveforms, ideal = simulate(board, transient, times=instants), self._reference(scene)
        measured, _ = measure_outputs(scene, board.circuit, ideal, waveforms, transient)
        settling, reading = math.inf, measured.settling_time
        if reading is not None:
            settling = max(reading.value, reading.alternative or 0.0)
        return settling, max(channel.overshoot for channel in measured.channels), True

    def _reference(self, scene: Scene) -> IdealAnswer:
        """Return the ideal answer, computed once where the tuned keys do not change it."""
        if self._ideal is None or not SAME_ANSWER.issuperset(self.paths):
            network = ideal_network(self.problem, scene)
            self._ideal = ideal_answer(network, scene)
        return self._ideal
