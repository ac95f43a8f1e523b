"""Verdicts of changed designs by the state-space engine, each computed once, within a time limit.

A change keeps lambda, and with it the solution, unless it changes lambda itself. A design with
parts that are hard to buy, or that the layout undoes (`part_warnings`), more so than those of the
scene, counts as refused. The
op-amps stay at the small-signal level: a design that exceeds 90 % of a limit of its parts does not
pass, though its verdict at the large-signal level might.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

from taction.netlist_gen.board.part_warnings import broken_limits
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.table import topology_of
from taction.system.errors import InputError, NoVerdictError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.stability.poles import poles
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.effort import Effort
from taction.verification.verdict.verify import Verdict, verify

BARE = Effort(details=False, full_margin=False)
# Keys whose change would change lambda where the scene gives a resistance.
MOVES_LAMBDA = {"design.gain", "design.unit_conductance", "design.unit_voltage"}


SAME = 1.0 + 1e-9  # ratio of values that count as equal


class OutOfTimeError(Exception):
    """The time limit of a search is over; no result of the search is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What the checks say about one design.

    Attributes
    ----------
    changes : dict
        New values by dotted paths.
    outcomes : dict
        Outcome of every check by its name; empty without a verdict.
    reasons : dict
        Reason of every check that does not pass.
    refused : str
        Why there is no verdict, or why the parts cannot be bought; else empty.
    settling_time, overshoot : float
        s (the longer one of a fragile reading) and fraction of the step amplitude; infinite if
        the board has none.
    """

    changes: dict[str, Value]
    outcomes: dict[str, Outcome]
    reasons: dict[str, str]
    refused: str = ""
    settling_time: float = math.inf
    overshoot: float = math.inf

    @property
    def passes(self) -> bool:
        """Whether every check passes with parts that can be bought."""
        return not self.refused and not self.left and bool(self.outcomes)

    @property
    def left(self) -> tuple[str, ...]:
        """Names of the checks that do not pass."""
        return tuple(name for name, one in self.outcomes.items() if one is not Outcome.PASS)


class Trials:
    """The trials of one scene.

    Parameters
    ----------
    scene : Scene
        Lambda is a number.
    seconds : float
        Time limit of all trials together, s, from now on.

    Raises
    ------
    InputError
        The problem of the scene cannot be made.
    """

    def __init__(self, scene: Scene, seconds: float = math.inf) -> None:
        self.scene = scene.with_engine("statespace")
        self.problem = make_problem(scene)
        self.lam = ideal_network(self.problem, scene).lam
        self.accepted = broken_limits(synthesise(scene, self.problem))
        self.limit = seconds
        self.deadline = self.end = time.monotonic() + seconds
        self._known: dict[tuple[tuple[str, Value], ...], Trial] = {}
        self._longest = 0.0  # s, of the trials so far

    @property
    def tried(self) -> tuple[Trial, ...]:
        """All trials so far."""
        return tuple(self._known.values())

    def share(self, parts: int) -> None:
        """Give the next search one of `parts` equal parts of the time that is left."""
        now = time.monotonic()
        self.deadline = now + max(self.end - now, 0.0) / parts

    def check_time(self) -> None:
        """Raise OutOfTimeError if the time of this search is over.

        Also if the time of all searches would be over before a trial as long as the longest ends.
        """
        now = time.monotonic()
        if now >= self.deadline or now + self._longest > self.end:
            raise OutOfTimeError

    def completed(self, changes: Mapping[str, Value]) -> dict[str, Value]:
        """Return `changes` with lambda, if they would change it."""
        moved = MOVES_LAMBDA.intersection(changes)
        moved -= {"design.unit_voltage"} if self.scene.design.amplifier == "linear" else set()
        held = moved and not {"design.lambda", "design.resistance"}.intersection(changes)
        return {**changes, **({"design.lambda": self.lam} if held else {})}

    def scene_at(self, changes: Mapping[str, Value], base: Scene | None = None) -> Scene:
        """Return the scene (or `base`) with a change and the same lambda.

        Raises
        ------
        InputError
            A value that its key does not accept.
        """
        return with_values(base or self.scene, self.completed(changes))

    def board_at(self, changes: Mapping[str, Value]) -> LinearBoard:
        """Return the board with a change.

        Raises
        ------
        InputError
            The board cannot be built.
        OutOfTimeError
            The time is over.
        """
        self.check_time()
        return LinearBoard(synthesise(self.scene_at(changes), self.problem))

    def resistance_at(self, changes: Mapping[str, Value]) -> float:
        """Return R of the board with a change, ohm."""
        scene = self.scene_at(changes)
        return topology_of(scene).facts(scene)["R"].value

    def at(self, changes: Mapping[str, Value]) -> Trial:
        """Return the trial of a change.

        Raises
        ------
        OutOfTimeError
            The time is over.
        """
        key = tuple(sorted(changes.items()))
        if key not in self._known:
            start = time.monotonic()
            self._known[key] = self._try(dict(changes))
            self._longest = max(self._longest, time.monotonic() - start)
        return self._known[key]

    def _try(self, changes: dict[str, Value]) -> Trial:
        try:
            board = self.board_at(changes)
            found = poles(board)
        except (InputError, NoVerdictError) as error:
            return Trial(changes, {}, {}, str(error))
        if found.certain and not found.stable:  # known without a transient
            return Trial(changes, {"stability": Outcome.FAIL}, {"stability": "it is unstable"})
        refused = self._refused(board)
        try:
            scene = at_small_signal(self.scene_at(changes))
            verdict = verify(scene, problem=self.problem, circuit=board, effort=BARE)
        except (InputError, NoVerdictError) as error:
            return Trial(changes, {}, {}, str(error))
        return trial_of(verdict, changes, refused)

    def _refused(self, board: LinearBoard) -> str:
        """Return which parts are out of range, and farther than those of the scene."""
        worse = [
            name
            for name, broken in broken_limits(board.circuit).items()
            if name not in self.accepted or broken.factor > SAME * self.accepted[name].factor
        ]
        return ", ".join(sorted(worse))


def at_small_signal(scene: Scene) -> Scene:
    """Return the scene with its op-amps at the small-signal level, if it leaves the level open."""
    if scene.design.opamp.level != "auto":
        return scene
    opamp = scene.design.opamp.model_copy(update={"level": "small-signal"})
    return scene.model_copy(update={"design": scene.design.model_copy(update={"opamp": opamp})})


def trial_of(verdict: Verdict, changes: dict[str, Value], refused: str = "") -> Trial:
    """Return what a verdict says about the design with `changes`."""
    settling, reading = math.inf, verdict.measurements.settling_time
    if reading is not None and verdict.poles.stable:
        settling = max(reading.value, reading.alternative or 0.0)
    overshoot = math.inf
    if verdict.poles.stable:
        overshoot = max(channel.overshoot for channel in verdict.measurements.channels)
    return Trial(
        changes=changes,
        outcomes={check.name: check.outcome for check in verdict.checks},
        reasons={c.name: c.reason for c in verdict.checks if c.outcome is not Outcome.PASS},
        refused=refused,
        settling_time=settling,
        overshoot=overshoot,
    )
