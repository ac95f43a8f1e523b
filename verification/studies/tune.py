"""The paper's CONSOLE step: the design with the least settling time under a limit on overshoot.

The state-space engine judges every candidate; the solution that the board computes stays the same,
because lambda is held (R follows). Settling time jumps where a ringing peak crosses the band, so
the search is a grid, then Nelder and Mead's simplex from the best points of it, never a gradient.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from netlist_gen.board.scalings import make_scalings
from netlist_gen.board.synthesis import synthesise
from netlist_gen.overrides.axes import with_values
from netlist_gen.overrides.keys import find_key, own_value
from netlist_gen.problem.inverse_problem import InverseProblem, make_problem
from netlist_gen.scene.scene import OvershootCheck, Scene, StabilityCheck
from spice_models.array_types import Floats
from spice_models.errors import Complaint, EngineError, InputError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients.exact import simulate
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from verification.pipeline.recording import measure_outputs
from verification.pipeline.transient_plan import plan_transient
from verification.small_signal.margin import capacitance_margin
from verification.small_signal.time_scales import time_scales

GRID = {1: 25, 2: 9, 3: 5}  # points a parameter, by how many there are
REACH = 20.0  # the grid spans the scene's own value over and times this
OVERSHOOT = 0.05  # limit where neither caller nor scene has one
STARTS = 3
STEPS = 40  # evaluations of one simplex
RESOLUTION = 40.0  # points on a ringing period while searching
LONGEST = 100_000  # points of a candidate's record; beyond, it rings too long to be a good design
RESERVE = 0.99  # of the overshoot limit: what is found is verified with the simulator's error
# Keys that leave the solution and the starting point as they are, with lambda held.
SAME_ANSWER = {"design.gain", "design.capacitance", "design.unit_conductance"}
INFEASIBLE = 1e6  # added to the objective outside the constraints, so that less outside is better


@dataclass(frozen=True, slots=True)
class Candidate:
    """One design that was tried.

    Attributes
    ----------
    values : dict of str to float
        Parameter values by dotted path.
    settling_time : float
        s; infinite if it does not settle. Of a fragile reading's two values the longer.
    overshoot : float
        Fraction of the step amplitude; infinite for an unstable board.
    stable : bool
        With the margin that was asked for.
    """

    values: dict[str, float]
    settling_time: float
    overshoot: float
    stable: bool


@dataclass(frozen=True, slots=True)
class Tuning:
    """What a search found.

    Attributes
    ----------
    before, after : Candidate
        The scene as it was, and the best design that keeps the limits.
    scene : Scene
        The scene with the best design in it; its checks ask for the limits.
    frontier : tuple of Candidate
        The trade-off: no design that was tried has both less overshoot and less settling time.
    tried : int
        Designs evaluated.
    overshoot_limit, margin : float
        The limits.
    """

    before: Candidate
    after: Candidate
    scene: Scene
    frontier: tuple[Candidate, ...]
    tried: int
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
        Limit, fraction of the step amplitude; by default the scene's own check, else `OVERSHOOT`.
    margin : float, optional
        Factor by which C may shrink; by default the scene's own check.

    Raises
    ------
    InputError
        A key that is none or not of the design, none at all, or too many; or the scene's own
        design cannot be built.
    EngineError
        No design within reach keeps the limits.
    """
    paths = _paths(scene, keys)
    own_check = scene.checks.overshoot
    limit = overshoot or (OVERSHOOT if own_check is None else own_check.max)
    search = _Search(scene, paths, limit, margin or scene.checks.stability.margin)
    own = np.log([_own(scene, path) for path in paths])
    before = search.assess(own)
    spread = np.linspace(-math.log(REACH), math.log(REACH), GRID[len(paths)])
    grid = [own + np.array(offset) for offset in product(spread, repeat=len(paths))]
    for done, point in enumerate(grid):
        progress(f"grid {done + 1} of {len(grid)}")
        search.assess(point)
    for number, start in enumerate(search.best(STARTS)):
        progress(f"simplex {number + 1} of {STARTS}")
        search.descend(start, own, float(spread[1] - spread[0]))
    after = search.best(1)[0]
    if search.objective(after) >= INFEASIBLE:
        raise search.hopeless()
    return Tuning(
        before=before,
        after=after,
        scene=search.finished(after),
        frontier=_frontier(search.seen),
        tried=len(search.seen),
        overshoot_limit=limit,
        margin=search.margin,
    )


def _paths(scene: Scene, keys: Iterable[str]) -> list[str]:
    paths = [find_key(scene, key).path for key in keys]
    if not 1 <= len(set(paths)) == len(paths) <= max(GRID):
        text = f"one to {max(GRID)} different keys can be tuned at once"
        raise InputError("--over", Complaint("keys", repr(",".join(paths)), text))
    for path in paths:
        if not path.startswith("design."):
            text = "only the design can be tuned, such as gain, capacitance or unit_conductance"
            raise InputError("--over", Complaint(path, "", text))
    return paths


def _own(scene: Scene, path: str) -> float:
    key = find_key(scene, path)
    value = own_value(scene, key) if key.kind == "real" else None
    if value is None or not 0 < value < math.inf:
        text = "has no value above zero of its own to start from"
        raise InputError("--over", Complaint(path, repr(value), text))
    return value


def _frontier(seen: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Return the designs that no other one beats in both respects, by growing overshoot."""
    found: list[Candidate] = []
    able = [c for c in seen if c.stable and math.isfinite(c.settling_time)]
    for candidate in sorted(able, key=lambda c: (c.overshoot, c.settling_time)):
        if not found or candidate.settling_time < found[-1].settling_time:
            found.append(candidate)
    return tuple(found)


class _Search:
    """Candidates of one search, each evaluated once."""

    def __init__(self, scene: Scene, paths: list[str], overshoot: float, margin: float) -> None:
        analysis = scene.analysis.model_copy(
            update={"points_per_period": RESOLUTION, "stop": "auto"}
        )
        self.base = scene.model_copy(update={"analysis": analysis})
        self.original, self.paths = scene, paths
        self.overshoot, self.margin = overshoot, margin
        self.problem: InverseProblem = make_problem(scene)
        self.lam = make_scalings(scene).lam
        self.seen: list[Candidate] = []
        self._ideal: IdealAnswer | None = None

    def scene_at(self, values: dict[str, float], base: Scene) -> Scene:
        """Return `base` with `values` and lambda held."""
        held = {} if "design.resistance" in values else {"design.lambda": self.lam}
        return with_values(base, {**held, **values})

    def finished(self, candidate: Candidate) -> Scene:
        """Return the original scene with a design that was found, its limits as checks."""
        limits: dict[str, Any] = {"overshoot": OvershootCheck(max=self.overshoot)}
        limits |= {"stability": StabilityCheck(margin=self.margin)}
        checks = self.original.checks.model_copy(update=limits)
        return self.scene_at(candidate.values, self.original.model_copy(update={"checks": checks}))

    def objective(self, candidate: Candidate) -> float:
        """Settling time, logarithmic, with the constraints as steps and slopes."""
        if not candidate.stable or not math.isfinite(candidate.settling_time):
            return 2 * INFEASIBLE
        excess = max(candidate.overshoot - RESERVE * self.overshoot, 0.0)
        return math.log(candidate.settling_time) + (INFEASIBLE * (1 + excess) if excess else 0.0)

    def best(self, count: int) -> list[Candidate]:
        """Return the best candidates so far."""
        return sorted(self.seen, key=self.objective)[:count]

    def hopeless(self) -> EngineError:
        """Say that nothing keeps the limits, and what came nearest."""
        nearest = min((c.overshoot for c in self.seen), default=math.inf)
        reached = f"the least overshoot of them is {100 * nearest:.3g} %. "
        return EngineError(
            f"no design within a factor of {REACH:g} keeps an overshoot of"
            f" {100 * self.overshoot:g} % and a margin of {self.margin:g} in C; tried"
            f" {len(self.seen)}, {reached if math.isfinite(nearest) else 'none has the margin. '}"
            "Loosen a limit, or tune another key, such as capacitance"
        )

    def assess(self, point: Floats) -> Candidate:
        """Evaluate one design and remember it."""
        values = dict(zip(self.paths, np.exp(point).tolist(), strict=True))
        try:
            settling, overshoot, stable = self._measure(self.scene_at(values, self.base))
        except (EngineError, InputError):  # no state space, or it cannot be built: no design
            if not self.seen:
                raise
            settling, overshoot, stable = math.inf, math.inf, False
        candidate = Candidate(values, settling, overshoot, stable)
        self.seen.append(candidate)
        return candidate

    def descend(self, start: Candidate, own: Floats, size: float) -> None:
        """Follow a simplex from `start` within reach of `own`; `size` is its first edge."""
        from scipy.optimize import minimize

        x0 = np.log([start.values[path] for path in self.paths])
        simplex = np.vstack([x0, x0 + 0.5 * size * np.eye(len(x0))])
        options: Any = {
            "initial_simplex": simplex,
            "maxfev": STEPS,
            "xatol": 1e-3,
            "fatol": 1e-4,
        }

        def goal(point: Floats) -> float:
            reach = math.log(REACH)
            return self.objective(self.assess(np.clip(point, own - reach, own + reach)))

        minimize(goal, x0.tolist(), method="Nelder-Mead", options=options)

    def _measure(self, scene: Scene) -> tuple[float, float, bool]:
        board = LinearBoard(synthesise(scene, self.problem))
        scales = time_scales(board, initial=scene.analysis.initial)
        if not np.all(scales.poles.real < 0):
            return math.inf, math.inf, False
        if self.margin > 1 and capacitance_margin(board, self.margin).factor < self.margin:
            return math.inf, math.inf, False
        transient = plan_transient(scene, scales, "statespace")
        if transient.stop / transient.max_step > LONGEST:
            return math.inf, math.inf, True
        waveforms, ideal = simulate(board, transient), self._reference(scene)
        found, _ = measure_outputs(scene, board.circuit, ideal, waveforms, transient)
        settling, reading = math.inf, found.settling_time
        if reading is not None:
            settling = max(reading.value, reading.alternative or 0.0)
        return settling, max(channel.overshoot for channel in found.channels), True

    def _reference(self, scene: Scene) -> IdealAnswer:
        """Return the reference; one serves every candidate where the keys do not change it."""
        if self._ideal is None or not SAME_ANSWER.issuperset(self.paths):
            network = ideal_network(self.problem, make_scalings(scene), scene)
            self._ideal = ideal_answer(network, scene)
        return self._ideal
