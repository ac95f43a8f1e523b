"""Trials: changed scenes, verified by the state-space engine, and searches over them.

A change keeps lambda, and with it the solution, unless it changes lambda itself. A design with
parts beyond the limits of real ones, farther than those of the scene, counts as refused. The
op-amps stay at the small-signal level: a design that exceeds 90 % of a limit of its parts does not
pass. The values of a key go outwards from the scene's own on both sides, the farther the wider
apart, and the first that passes is the nearest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.bill_of_materials import buyable, series_of
from taction.netlist_gen.board.part_warnings import AcceptedParts, BrokenLimit, broken_limits
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import read_ends, with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value, find_key, own_value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import Complaint, EngineError, InputError, NoVerdictError
from taction.system.quantities import percent
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.reference.ideal_answer import ideal_answer, ideal_network
from taction.verification.stability.poles import poles
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.input_spread import InputSpread
from taction.verification.verdict.record import FIGURES, Record
from taction.verification.verdict.verify import verify

OPAMP, LAMBDA = "design.opamp", "design.lambda"
KEPT = {"level", "input_errors"}  # keys of an op-amp that say how it is simulated

VERDICT = 10.0  # designs: the work of a verdict
STEPPED = 20.0  # times as much: that of a board whose transient takes steps
POLES = 2.0  # designs: the work of poles with bounds
STATES = 70.0  # of a board whose decomposition costs as much as all that grows slower with it
LONGEST = 1000.0  # rad in a time constant, of a board whose transient takes steps
CLEARLY = 2.0  # times the limit: a board that rests farther away needs no transient


class OutOfWorkError(Exception):
    """The work of a search is used up; no result of the search is wrong."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What the checks say about one design."""

    DOCUMENT: ClassVar[tuple[str, ...]] = (
        *("values", "settling_time [s]", "overshoot [step]"),
        *("left = record.failed # checks that do not pass", "refused"),
    )

    values: dict[str, Value]  # new numbers and names by dotted paths
    record: Record  # of the verdict, or why there is none
    # Which of its parts cannot be bought, or the layout undoes, or why there is no verdict.
    refused: str = ""

    @property
    def good(self) -> bool:
        """Whether every check passes with parts that can be bought."""
        return self.record.outcome == Outcome.PASS.value and not self.refused

    @property
    def settling_time(self) -> float:
        """The settling time, s, of a fragile reading the longer one; infinite without one."""
        reading = self.record.figure("settling_time")
        if reading.value is None or not self.record.stable:
            return math.inf
        return max(reading.value, reading.alternative or 0.0)

    @property
    def overshoot(self) -> float:
        """The largest overshoot, fraction of the step; infinite for an unstable board."""
        value = self.record.value("overshoot")
        return math.inf if value is None or not self.record.stable else value


class Trials:
    """The trials of one scene, whose lambda is a number.

    `work`: most work of all trials together (`Trials.spend`). `accepted`: parts beyond the limits
    that are not refused, by default those of the scene. `rest_first`: a board that rests far beyond
    the limit is judged without a transient. InputError: the problem of the scene cannot be made.
    """

    def __init__(
        self,
        scene: Scene,
        work: float = math.inf,
        accepted: AcceptedParts | None = None,
        *,
        rest_first: bool = False,
    ) -> None:
        self.scene = scene.with_engine("statespace")
        self.lam = ideal_network(make_problem(scene), scene).lam
        self.accepted = accepted or accepted_parts(scene)
        self.limit, self.spent, self.rest_first = work, 0.0, rest_first
        self._known: dict[tuple[tuple[str, Value], ...], Trial] = {}

    @property
    def tried(self) -> tuple[Trial, ...]:
        """All trials so far."""
        return tuple(self._known.values())

    def spend(self, designs: float, board: LinearBoard) -> None:
        """Count work, which grows with the cube of the states; `OutOfWorkError` if too much."""
        work = designs * (1.0 + (board.state_space.n / STATES) ** 3)
        if self.spent + work > self.limit:
            raise OutOfWorkError
        self.spent += work

    def completed(self, changes: Mapping[str, Value]) -> dict[str, Value]:
        """Return `changes` with lambda, if they would change it.

        Another op-amp is a `preset`.
        """
        kept = preset(self.scene, str(changes[OPAMP])) if OPAMP in changes else {}
        return {**kept, **with_lambda_held(self.scene, changes, self.lam)}

    def scene_at(self, changes: Mapping[str, Value]) -> Scene:
        """Return the scene with a change and the same lambda; `InputError` if a key refuses it."""
        return with_values(self.scene, self.completed(changes))

    def built(self, changes: Mapping[str, Value]) -> tuple[Scene, LinearBoard]:
        """Return scene and board with a change; `InputError`, or `OutOfWorkError` as `spend`."""
        scene = at_small_signal(self.scene_at(changes))
        board = LinearBoard(synthesise(scene))
        self.spend(POLES, board)
        return scene, board

    def at(self, changes: Mapping[str, Value]) -> Trial:
        """Return the trial of a change; `OutOfWorkError` as `spend`."""
        key = tuple(sorted(changes.items()))
        if key not in self._known:
            try:
                self._known[key] = self._try(dict(changes))
            except (InputError, NoVerdictError) as error:
                record = Record.without_verdict(error, "statespace")
                self._known[key] = Trial(dict(changes), record, str(error))
        return self._known[key]

    def _try(self, changes: dict[str, Value]) -> Trial:
        """Verify a change; a board whose poles or rest show that it fails needs no transient."""
        scene, board = self.built(changes)
        found, fail = poles(board), Outcome.FAIL
        if found.known_unstable:
            rate, reason = found.rightmost.real, "it is unstable"
            lost = ["steady_state", "settling_time"]
            lost += ["overshoot"] * (scene.checks.overshoot is not None)
            stability = Check("stability", fail, rate, found.resolution, unit="1/s", reason=reason)
            others = (Check(name, fail, reason=reason) for name in lost)
            return Trial(changes, _without_transient(False, reason, stability, *others))
        limit = scene.checks.steady_state.tolerance
        if self.rest_first:
            rest = rest_distance(scene, board)
            if rest > CLEARLY * limit:
                reason = f"rests {percent(rest)} off the reference"
                steady = Check("steady_state", fail, rest, None, 0.0, limit, "step", reason)
                stability = Check("stability", Outcome.PASS, unit="1/s")
                return Trial(changes, _without_transient(True, reason, stability, steady))
        linear = board.circuit.is_linear and scene.design.opamp.level != "large-signal"
        if not linear and found.damping_ratio * LONGEST < 1.0:
            ratio = f"{found.damping_ratio:.2g}"
            raise EngineError(f"its damping ratio is {ratio}: it rings too long for a search")
        self.spend(VERDICT if linear else STEPPED * VERDICT, board)
        verdict = verify(scene, circuit=board, full_margin=False)
        passes = verdict.outcome is Outcome.PASS
        refused = self.accepted.refused(broken_at_rest(board)) if passes else ""
        return Trial(changes, Record.of(verdict, channels=False), refused)


def _without_transient(stable: bool, reason: str, *checks: Check) -> Record:
    """Return the record of a board that fails by its poles, or at rest."""
    none = dict[str, float | None].fromkeys(FIGURES)
    return Record("fail", "statespace", reason=reason, stable=stable, figures=none, checks=checks)


def rest_distance(scene: Scene, board: LinearBoard) -> float:
    """Return how far 95 % of the boards rest from the answer, in steps; 0 if nothing varies."""
    answer = ideal_answer(ideal_network(make_problem(scene), scene), scene)
    step = float(np.abs(answer.target - answer.start).max(initial=0.0))
    try:
        spread = InputSpread.of(board)
    except EngineError:
        return math.inf
    if spread is None or not step:
        return 0.0
    return spread.distance(answer.target)[0] / step


def accepted_parts(scene: Scene) -> AcceptedParts:
    """Return what a proposal may have beyond the limits of real parts: what the scene has."""
    return AcceptedParts(broken_at_rest(LinearBoard(synthesise(scene))))


def broken_at_rest(board: LinearBoard) -> Mapping[str, BrokenLimit]:
    """Return what parts of a board break, with what they do at rest if there is an equilibrium."""
    try:
        return broken_limits(board.circuit, board.equilibrium.__getitem__)
    except EngineError:
        return broken_limits(board.circuit)


def with_lambda_held(scene: Scene, changes: Mapping[str, Value], lam: float) -> dict[str, Value]:
    """Return changes with lambda, if they would change it and do not give it."""
    given = {LAMBDA, "design.resistance"}.intersection(changes)
    knobs = topology_of(scene).knobs(scene)
    moved = any(knob.key in changes and "lambda" in knob.moves for knob in knobs)
    return {**changes, **({LAMBDA: lam} if moved and not given else {})}


def preset(scene: Scene, name: str) -> dict[str, Value]:
    """Return the changes to another op-amp, whose level and input errors stay what is asked for."""
    opamp = scene.design.opamp
    kept = sorted(KEPT & opamp.model_fields_set)
    return {**{f"{OPAMP}.{key}": getattr(opamp, key) for key in kept}, OPAMP: name}


def at_small_signal(scene: Scene) -> Scene:
    """Return the scene with its op-amps at the small-signal level, if it leaves the level open."""
    if scene.design.opamp.level != "auto":
        return scene
    return with_values(scene, {"design.opamp.level": "small-signal"})


OUTWARDS, DECADES = 25, 2.0  # values of one key on each side, and how far they go
HALVINGS = 4  # of the distance of two of them
EVALUATIONS = 40  # of one descent

Values = dict[str, Value]
Accept = Callable[[Trial], bool]

is_good: Accept = attrgetter("good")
"""Whether every check passes with parts that can be bought."""


@dataclass(frozen=True, slots=True)
class SearchRange:
    """The values of one key, above zero, that can be bought."""

    path: str
    unit: str
    own: float  # the scene's value
    low: float  # ends of the range
    high: float
    series: str  # of the values; "exact" for all numbers of three digits

    @classmethod
    def around(cls, scene: Scene, path: str, factor: float) -> SearchRange | None:
        """Return the range around the scene's value; None if it has no value above zero."""
        key = find_key(scene, path)
        own = own_value(scene, key) if key.kind == "real" else None
        if own is None or not 0.0 < own < math.inf:
            return None
        series = series_of(scene.design, key.path)
        return cls(key.path, key.unit, own, own / factor, own * factor, series)

    def bought(self, value: float) -> float:
        """Return the nearest value that can be bought."""
        return buyable(value, self.series)

    def values(self, points: int) -> tuple[float, ...]:
        """Return values with logarithmic spacing from `low` to `high`, each once."""
        spaced = np.geomspace(self.low, self.high, points if self.low < self.high else 1)
        return tuple(dict.fromkeys(map(self.bought, spaced.tolist())))

    def outwards(self) -> tuple[float, ...]:
        """Return the values on both sides of the scene's own, the nearest first."""
        away = (DECADES * (k / OUTWARDS) ** 1.5 for k in range(OUTWARDS + 1))  # 4 % to 32 % apart
        tried = [self.bought(self.own * 10.0 ** (side * by)) for by in away for side in (1, -1)]
        return tuple(value for value in dict.fromkeys(tried) if value != self.own)


def parse_ranges(
    scene: Scene, keys: Iterable[str], reach: float, most: int
) -> tuple[SearchRange, ...]:
    """Return the ranges of one to `most` keys: ``"gain"`` or ``"gain=1M:10M"``."""
    texts = [key.partition("=") for key in keys]
    found = {find_key(scene, name.strip()): body.strip() for name, _, body in texts}
    if not 1 <= len(found) == len(texts) <= most:
        paths = ",".join(find_key(scene, name.strip()).path for name, _, _ in texts)
        text = f"give one to {most} different keys"
        raise InputError("--over", Complaint("keys", repr(paths), text))
    for key, body in found.items():
        if not key.path.startswith("design."):
            text = "only the design can be tuned, such as gain, capacitance or unit_conductance"
            raise InputError("--over", Complaint(key.path, "", text))
        if key.kind == "choice":
            text = "a search needs a key with numbers; `taction sweep` tries names"
            raise InputError("--over", Complaint("axis", repr(f"{key.path}={body}"), text))
    return tuple(search_range(scene, key.path, body, reach) for key, body in found.items())


def search_range(
    scene: Scene, path: str, body: str, reach: float, option: str = "--over"
) -> SearchRange:
    """Return the range ``"LOW:HIGH"`` of a key, by default around the scene's value."""
    found = SearchRange.around(scene, path, reach)
    if found is None:
        text = "the scene has no value above zero of this key, from which the search could start"
        own = own_value(scene, find_key(scene, path))
        raise InputError(option, Complaint(path, repr(own), text))
    low, high = read_ends(scene, path, body, option) if body else (found.low, found.high)
    return replace(found, low=low, high=high)


@dataclass(slots=True)
class Search:
    """The search over one key, and what it found."""

    DOCUMENT = ("key = path", "from = least", "to = most", "complete # the work sufficed")

    path: str
    least: float | None = None  # ends of the values that are tried, of a key with a range
    most: float | None = None
    found: list[Trial] = field(default_factory=list)  # those that are accepted
    complete: bool = True


def search(
    trials: Trials, path: str, values: Sequence[Value] | None = None, accept: Accept = is_good
) -> Search | None:
    """Try all `values` of a key; or those outwards from the scene's own, until one is accepted.

    None without a value to try. A search that uses up the work is not complete.
    """
    found, one = Search(path), None
    if values is None and (one := SearchRange.around(trials.scene, path, 1.0)) is not None:
        values = one.outwards()
        found.least, found.most = min(one.own, *values), max(one.own, *values)
    if not values:
        return None
    last = dict[bool, Trial]()  # on either side of the scene's own
    try:
        for value in values:
            trial = trials.at({path: value})
            if one is not None:
                above = float(value) > one.own
                near, last[above] = last.get(above, trial), trial
                trial = _between(trials, one, near, trial, accept)
            if accept(trial):
                found.found.append(trial)
                if one is not None:
                    break
    except OutOfWorkError:
        found.complete = False
    return found


def _between(trials: Trials, one: SearchRange, low: Trial, far: Trial, accept: Accept) -> Trial:
    """Return `far`, or what is accepted between it and a neighbour that fails by other checks."""
    high = far
    for _ in range(HALVINGS):
        failed, others = {*low.record.failed}, {*high.record.failed}
        if not (failed and others) or failed & others:
            break
        ends = float(low.values[one.path]), float(high.values[one.path])
        middle = trials.at({one.path: one.bought(math.sqrt(math.prod(ends)))})
        if accept(middle):
            return middle
        low, high = (middle, high) if failed & {*middle.record.failed} else (low, middle)
    return far


def descend(
    objective: Callable[[Values], float],
    ranges: Sequence[SearchRange],
    start: Values,
    spacings: Sequence[float],
) -> None:
    """Search the least objective along each key in turn; `spacings` are natural logarithms.

    Where no step is better, the next ones are half as long.
    """
    best, steps = start, np.asarray(spacings)
    for _ in range(EVALUATIONS // (2 * len(ranges))):
        moved = [
            best | {one.path: one.bought(min(max(value, one.low), one.high))}
            for one, step in zip(ranges, steps.tolist(), strict=True)
            for value in (float(best[one.path]) * math.exp(way) for way in (-step, step))
        ]
        found = min(moved, key=objective)
        better = objective(found) < objective(best)
        best, steps = (found, steps) if better else (best, 0.5 * steps)
