"""What to change on a board whose checks fail: the nearest changes that mend it, each verified.

Every failed check has its own keys (`mending_keys`). Over each key one search goes outwards from
the scene's value to the nearest value with which the state-space engine's verdict passes. What an
unstable board needs is solved on the poles first: the search begins at the edge of the stable
range. Where no single key mends a transient, two knobs are changed together. A board that rests
beyond the limit is judged at rest; where no change mends all, the nearest of these is followed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.part_warnings import ANY_PART
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.reading_definitions import READINGS
from taction.verification.design.nearest import Search, search_key, search_list, search_pair
from taction.verification.design.stable_ranges import StableRange, stable_ranges
from taction.verification.design.trials import (
    OPAMP,
    OutOfWorkError,
    Trial,
    Trials,
    knobs_with_margin,
)
from taction.verification.verdict.cause import following
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import ERROR
from taction.verification.verdict.verify import Verdict

LIMIT = 1000.0  # designs: the work of a search
SERIES = ("E24", "E96", "E192", "exact")
SUPPLIES = (5.0, 9.0, 12.0, 15.0, 18.0, 22.0)
SHOWN = 4  # op-amps that are proposed


@dataclass(frozen=True, slots=True)
class Change:
    """A change with what the state-space verdict says about it."""

    DOCUMENT = (
        *("values", "mends", "left # checks that do not pass with the change"),
        *("resistance [ohm]", "verified", "engine = 'statespace'"),
    )

    values: dict[str, Value]  # new values by dotted paths, with a lambda where it is held
    mends: tuple[str, ...]  # the failed checks that pass with the change
    left: tuple[str, ...]  # the checks that do not pass; empty where the verdict is a pass
    resistance: float | None = None  # R of the changed board where it differs from the scene's, ohm

    @property
    def verified(self) -> bool:
        """Whether the verdict is a pass."""
        return not self.left


@dataclass(frozen=True, slots=True)
class Remedies:
    """The changes that were found for a verdict that fails.

    Attributes
    ----------
    failed : tuple of str
        The failed checks.
    stability : tuple of StableRange
        The nearest stable ranges of an unstable board.
    changes : tuple of Change
        Those that mend everything, else those of them that mend most, with a verdict.
    without : tuple of Search
        The searches over keys that mend nothing.
    searched : tuple of str
        The keys that were searched, each once.
    cut : tuple of tuple of str
        Keys whose search ended when its work was used up.
    unmendable : tuple of str
        Failed checks that no change of the design mends.
    opamps : tuple of str
        The presets with which an unstable board is stable.
    trials : int
        Number of changes that were judged.
    undecided : tuple of str
        Why some of them have no verdict, a reason for each.
    work, limit : float
        The work done, and the most that is allowed, in designs (`Trials.spend`).
    """

    DOCUMENT = (
        *("failed", "stable_ranges = by_path", "stable_opamps = opamps", "changes", "without"),
        "not_searched = cut # these searches ended when the work was used up",
        *("searched", "unmendable", "trials", "undecided # why changes have no verdict"),
        *("work # in designs", "work_limit = limit"),
    )

    failed: tuple[str, ...]
    stability: tuple[StableRange, ...]
    changes: tuple[Change, ...]
    without: tuple[Search, ...]
    searched: tuple[str, ...]
    cut: tuple[tuple[str, ...], ...]
    unmendable: tuple[str, ...]
    opamps: tuple[str, ...]
    trials: int
    undecided: tuple[str, ...]
    work: float
    limit: float

    @property
    def by_path(self) -> dict[str, StableRange]:
        """`stability` by the path of the key."""
        return {each.path: each for each in self.stability}


def mending_keys(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Return the keys that can mend each check; no key mends a check that is not listed.

    A transient follows the knobs with a stability margin, and the op-amp. Keys that the topology
    does not read mend nothing.
    """
    knobs = knobs_with_margin(scene)
    idle = {f"design.{key}" for key in topology_of(scene).unused}
    mending = {
        **dict.fromkeys(("stability", *READINGS), (*knobs, OPAMP)),
        "steady_state": (
            "design.resistor_series",
            "design.prune",
            OPAMP,
            "design.unit_conductance",
            "design.gain",
            "design.lambda",
        ),
        "headroom": ("design.unit_voltage", OPAMP, "design.supply"),
        "noise": (OPAMP, *knobs, "design.unit_voltage"),
    }
    return {name: tuple(k for k in keys if k not in idle) for name, keys in mending.items()}


def find_remedies(
    verdict: Verdict, work: float = LIMIT, *, any_part: bool = False
) -> Remedies | None:
    """Return the nearest changes that mend a failed verdict; None for any other outcome.

    `work` and the errors are those of `taction.what_to_change`; the result is the same on every
    machine. Seven channels: 30 to 130 verdicts of 20 ms.
    """
    failed = tuple(check.name for check in verdict.checks if check.outcome is Outcome.FAIL)
    if not failed:
        return None
    trials = Trials(verdict.scene, work, ANY_PART if any_part else None, rest_first=True)
    follows, keys = following(verdict.checks), mending_keys(verdict.scene)
    knobs = knobs_with_margin(verdict.scene)
    causes = [name for name in failed if name not in follows]
    unmendable = tuple(name for name in failed if name not in keys)
    paths = [] if unmendable else list(dict.fromkeys(p for name in causes for p in keys[name]))
    unstable = verdict.poles.known_unstable and paths
    ranges = stable_ranges(trials, knobs) if unstable else ()
    edges = {each.path: each.edge for each in ranges if each.edge is not None}
    if verdict.parts.largest_unit_voltage is not None:
        edges["design.unit_voltage"] = verdict.parts.largest_unit_voltage
    searches = {
        each.path: Search((each.path,), each.least, each.most)
        for each in ranges
        if not each.found and not each.reason
    }
    paths = [path for path in paths if path not in searches]
    for place, path in enumerate(paths):
        share = 2.0 / (1 + len(paths) - place)  # the first keys, twice an equal part
        trials.limit = trials.spent + share * (work - trials.spent)
        search = _search(trials, path, edges.get(path))
        searches |= {} if search is None else {path: search}
    trials.limit = work
    transient = not unmendable and all(name in ("stability", *READINGS) for name in causes)
    found = {path for path, search in searches.items() if search.found}
    if transient and len(knobs) > 1 and not found.intersection(knobs):
        pair = search_pair(trials, (knobs[0], knobs[1]))
        searches |= {} if pair is None else {"pair": pair}
    if not found:
        _follow_nearest(trials)
    passing = [trial for search in searches.values() for trial in search.found[:SHOWN]]
    opamps = (t.values[OPAMP] for t in trials.tried if {OPAMP} == {*t.values} and _stable(t))
    return Remedies(
        failed=failed,
        stability=ranges,
        changes=tuple(_change(trials, failed, trial) for trial in passing or _best(trials, failed)),
        without=tuple(s for s in searches.values() if s.complete and not s.found),
        searched=tuple(dict.fromkeys(path for s in searches.values() for path in s.paths)),
        cut=tuple(s.paths for s in searches.values() if not s.complete),
        unmendable=unmendable,
        opamps=tuple(map(str, opamps)) if ranges else (),
        trials=len(trials.tried),
        undecided=tuple(t.reason for t in trials.tried if t.outcome == ERROR),
        work=trials.spent,
        limit=trials.limit,
    )


def _stable(trial: Trial) -> bool:
    return trial.passed("stability")


def _mended(failed: Sequence[str], trial: Trial) -> tuple[str, ...]:
    """Return the failed checks that pass."""
    return tuple(name for name in failed if trial.passed(name))


def _follow_nearest(trials: Trials) -> None:
    """Follow, for each set of keys, the transient of the board that rests nearest to the answer."""
    nearest: dict[frozenset[str], Trial] = {}
    for trial in sorted(trials.tried, key=lambda trial: trial.rest):
        if trial.rest:
            nearest.setdefault(frozenset(trial.values), trial)
    with suppress(OutOfWorkError):
        for trial in nearest.values():
            trials.whole(trial)


def _best(trials: Trials, failed: Sequence[str]) -> list[Trial]:
    """Return the first trial that mends most checks, for each set of keys."""
    best: dict[frozenset[str], Trial] = {}
    most = max(
        (len(_mended(failed, t)) for t in trials.tried if not (t.refused or t.rest)), default=0
    )
    for trial in trials.tried:
        if most and not (trial.refused or trial.rest) and len(_mended(failed, trial)) == most:
            best.setdefault(frozenset(trial.values), trial)
    return list(best.values())


def _change(trials: Trials, failed: Sequence[str], trial: Trial) -> Change:
    values, resistance = trials.completed(trial.values), None
    if "design.lambda" in values:
        scene = trials.scene_at(trial.values)
        fact = topology_of(scene).facts(scene).get("R")
        resistance = None if fact is None else fact.value
    return Change(values, _mended(failed, trial), trial.left, resistance)


def _search(trials: Trials, path: str, edge: float | None) -> Search | None:
    """Return the search over a key; None where it has no values."""
    values = _listed(trials.scene, path)
    if values is None:
        return search_key(trials, path, edge)
    return search_list(trials, path, values) if values else None


def _listed(scene: Scene, path: str) -> Sequence[Value] | None:
    """Return the values of a key that has a list of them, the nearest first; else None."""
    design = scene.design
    if path == OPAMP:
        return _opamps(scene)
    if path == "design.resistor_series":
        finer = SERIES[SERIES.index(design.resistor_series) + 1 :]
        return finer
    if path == "design.prune":
        return [design.prune / 3.0, design.prune / 10.0, 0.0] if design.prune else []
    if path == "design.supply":
        return sorted((v for v in SUPPLIES if v > design.supply), key=lambda v: v - design.supply)
    return None


def _opamps(scene: Scene) -> list[Value]:
    """Return the presets, the one with the nearest bandwidth first; not the scene's own.

    To an op-amp without a bandwidth, an ideal one, the fastest is nearest.
    """
    own, changed = choose_opamp(scene), scene.design.opamp

    def distance(name: str) -> float:
        gbw = OPAMPS[name].gbw
        return abs(math.log(gbw / own.gbw)) if math.isfinite(own.gbw) else -gbw

    names = (
        name
        for name, part in OPAMPS.items()
        if math.isfinite(part.gbw) and (name != changed.base or own.name != name)
    )
    return [*sorted(names, key=distance)]
