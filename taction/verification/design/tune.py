"""The paper's CONSOLE step: the design with the least settling time that every check accepts.

The verdict of the state-space engine judges every design, by all checks of the scene and the
limits of the search, and with values that can be bought; lambda is constant. Settling time jumps
where a ringing peak crosses the band, so the search uses no gradient: a grid, then steps along each
key from its best points, which become shorter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import write_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, EngineError, InputError
from taction.system.progress import Progress
from taction.system.quantities import percent, show, spaced
from taction.system.results import Result
from taction.verification.design.trials import (
    SearchRange,
    Trial,
    Trials,
    Values,
    descend,
    parse_ranges,
)
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.verdict.record import ERROR
from taction.verification.verdict.verify import Verdict, verify

GRID = {1: 25, 2: 9, 3: 5}  # points of each parameter, by the number of parameters
OVERSHOOT = 0.05  # default limit
AT_EDGE = 0.02  # of the logarithmic range: a value so close to an end is at its edge
STARTS = 3  # points of the grid from which a descent starts
RESERVE = 0.99  # of the overshoot limit: the verification adds the simulator's error
INFEASIBLE = 1e6  # added to the objective for every check that does not pass


@dataclass(frozen=True, slots=True)
class Tuned(Result):
    """The best design of a search, and its verdict."""

    VIEW = "taction.verification.report.views.design_view:tuning_view"
    DOCUMENT = (
        *("outcome = verdict.outcome", "before", "after"),
        "resistance [ohm] = verdict.circuit.facts.R.value",
        "lambda = verdict.circuit.facts.lambda.value",
        *("overshoot_limit [step]", "margin", "tried", "ranges = ends", "at_edges"),
        "verification = verdict",
    )

    before: Trial = field(repr=False)  # the design of the scene
    after: Trial = field(repr=False)  # the best design within the limits
    scene: Scene = field(repr=False)  # with the best design, and the limits as checks
    tried: int  # designs
    overshoot_limit: float
    margin: float
    ranges: tuple[SearchRange, ...] = field(repr=False)
    verdict: Verdict
    trials: tuple[Trial, ...] = field(repr=False)  # all that were tried, the scene's own first

    @property
    def ends(self) -> dict[str, tuple[float, ...]]:
        """The ends of the ranges, by dotted path."""
        return {each.path: (each.low, each.high) for each in self.ranges}

    @property
    def at_edges(self) -> dict[str, float]:
        """The ends of the ranges at which the best design lies, by dotted path."""
        edges = {}
        for each in self.ranges:
            value, close = float(self.after.values[each.path]), (each.high / each.low) ** AT_EDGE
            if value <= each.low * close:
                edges[each.path] = each.low
            elif value >= each.high / close:
                edges[each.path] = each.high
        return edges

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.verdict.outcome.value)


def tune(
    scene: str | Path | Scene,
    *,
    over: str | Sequence[str] = "gain",
    reach: float = 20.0,
    overshoot: float | None = None,
    margin: float | None = None,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Tuned:
    """Find the values with the least settling time, at the scene's lambda, and verify the design.

    The search uses the state-space engine, all checks of the scene, and values that can be bought:
    in the scene's series, else of three digits. The verification decides the exit status; its
    checks include the limits of the search.

    Parameters
    ----------
    scene : path or Scene
        The board to begin with.
    over : str or sequence of str
        Keys to change, each with an optional range: gain,capacitance or gain=1M:10M.
    reach : float
        A key without a range goes from its value divided by this factor to its value times it.
    overshoot : float, optional
        Largest overshoot, fraction of the step; by default the scene's limit, or 0.05.
    margin : float, optional
        Factor by which C must be able to shrink; by default the scene's margin.
    output : path, optional
        Write the scene with the best design.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Tuned
        The designs `before` and `after`, and the `verdict` of the best design.

    Raises
    ------
    InputError
        The scene, a key or a range cannot be used.
    NoVerdictError
        No design passes the checks; the message has the one that came closest.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/tuned-breadboard.toml").with_engine("statespace")
    >>> tuned = taction.tune(scene, over="gain", reach=4.0)
    >>> tuned.after.settling_time <= tuned.before.settling_time
    True
    """
    scene = read_scene(scene)
    named = over.split(",") if isinstance(over, str) else over
    if not 1.0 < reach < math.inf:
        accepted = "expected a factor above 1, such as 10"
        raise InputError("--reach", Complaint("FACTOR", repr(reach), accepted))
    keys = [key.strip() for key in named if key.strip()]
    ranges = parse_ranges(scene, keys, reach, max(GRID))
    check = scene.checks.overshoot
    limit = (OVERSHOOT if check is None else check.max) if overshoot is None else overshoot
    margin = scene.checks.stability.margin if margin is None else margin
    limited = with_values(scene, {"checks.overshoot.max": limit, "checks.stability.margin": margin})
    trials = Trials(limited)
    after = _search(trials, ranges, limit, progress)
    if not (after.good and after.overshoot <= RESERVE * limit):
        raise _no_design(trials, ranges, after, f"{100 * limit:g} % and a margin of {margin:g}")
    best, tried = with_values(limited, trials.completed(after.values)), trials.tried
    verdict = verify(best, progress)
    if output is not None:
        write_scene(best, output)
    return Tuned(tried[0], after, best, len(tried), limit, margin, ranges, verdict, tried)


def _search(
    trials: Trials, ranges: Sequence[SearchRange], overshoot: float, progress: Progress
) -> Trial:
    """Return the best design of a grid, and of descents from the best of its points."""
    own: Values = {each.path: each.own for each in ranges}
    if trials.at(own).record.outcome == ERROR:
        trials.built(own)  # raises the error of the scene's own design

    def objective(trial: Trial) -> float:
        """Return ln(settling time), plus a penalty for every check that does not pass."""
        broken = len(trial.record.failed) + bool(trial.refused)
        if not math.isfinite(trial.settling_time):
            return (100 + broken) * INFEASIBLE
        excess = max(trial.overshoot - RESERVE * overshoot, 0.0)
        penalty = INFEASIBLE * (broken + min(excess, 1.0) + bool(excess))
        return math.log(trial.settling_time) + penalty

    points = GRID[len(ranges)]
    grid = [*product(*(each.values(points) for each in ranges))]
    for number, point in enumerate(grid, 1):
        progress(f"grid {number} of {len(grid)}")
        trials.at(dict(zip(own, point, strict=True)))
    spacings = [0.5 * math.log(each.high / each.low) / (points - 1) for each in ranges]
    for number, start in enumerate(sorted(trials.tried, key=objective)[:STARTS], 1):
        progress(f"descent {number} of {STARTS}")
        descend(lambda values: objective(trials.at(values)), ranges, start.values, spacings)
    return min(trials.tried, key=objective)


def _no_design(
    trials: Trials, ranges: Sequence[SearchRange], closest: Trial, limits: str
) -> EngineError:
    """Return the error that no design passes, with the one that came closest."""
    values = ", ".join(f"{r.path} = {show(float(closest.values[r.path]), r.unit)}" for r in ranges)
    ends = ", ".join(
        f"{r.path} from {show(r.low, r.unit, 3)} to {show(r.high, r.unit, 3)}" for r in ranges
    )
    failing = closest.refused or ", ".join(map(spaced, closest.record.failed)) or "overshoot"
    reached = ""
    if math.isfinite(closest.overshoot):
        reached = f" with an overshoot of {percent(closest.overshoot)}"
    return EngineError(
        f"no design passes every check with an overshoot of {limits} in C; tried"
        f" {len(trials.tried)} over {ends}. The closest is {values}{reached}: it does not pass"
        f" {failing}. Loosen a limit, give another range, or tune another key"
    )
