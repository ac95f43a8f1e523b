"""What to change on a board whose checks fail: the nearest changes that mend it, each verified.

Every failed check has its own keys (`mending_keys`). Over each key one loop goes outwards from the
scene's value, or from the edge of the nearest stable range, to the first value with which the
state-space engine's verdict passes. Where no single key mends a transient, two knobs are changed
together. Lambda, and with it the solution, stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.part_warnings import ANY_PART
from taction.netlist_gen.scene.keys import Value, find_key, own_value
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import InputError, NoVerdictError
from taction.system.reading_definitions import READINGS
from taction.verification.design.trials import (
    OPAMP,
    OutOfWorkError,
    Search,
    Trial,
    Trials,
    knobs_with_margin,
    search,
    search_key,
    search_pair,
)
from taction.verification.stability.edges import Edges
from taction.verification.stability.families import Family, find_edges, unrounded
from taction.verification.verdict.checks import Outcome, following
from taction.verification.verdict.record import ERROR
from taction.verification.verdict.verify import Verdict

REACH = 100.0  # the search goes from the scene's value divided by it to the value times it
POINTS = 25  # over a key that is no knob of the board
OTHERS = ("design.stray_capacitance", "design.opamp.gbw")  # keys beside the knobs with a margin


@dataclass(frozen=True, slots=True)
class StableRange:
    """The stable range of one key nearest to the scene's value; an end is None if not reached."""

    DOCUMENT = (
        *("path", "unit", "own", "least # the search began here", "most # and ended here"),
        *("low", "high", "found", "reason", "edge", "factor # from the own value to the edge"),
        *("text = verification.report.views.design_view:distance_text()", "doubt = ''"),
    )

    path: str
    unit: str
    own: float  # the scene's value
    least: float  # ends of the search
    most: float
    low: float | None = None
    high: float | None = None
    found: bool = False
    reason: str = ""  # why the range is not known

    @property
    def edge(self) -> float | None:
        """The end of the range that is nearest to the scene's value."""
        edges = [edge for edge in (self.low, self.high) if edge is not None]
        return min(edges, key=lambda edge: abs(math.log(edge / self.own)), default=None)

    @property
    def factor(self) -> float | None:
        """The factor from the scene's value to stability."""
        return None if self.edge is None else self.edge / self.own

    def nearest(self, edges: Edges) -> StableRange:
        """Return the stable range of `edges` that is nearest to the scene's value."""

        def distance(ends: tuple[float, float]) -> float:
            return max(math.log(ends[0] / self.own), math.log(self.own / ends[1]), 0.0)

        if not edges.stable_ranges:
            return self
        low, high = min(edges.stable_ranges, key=distance)
        least, most = (low if low > edges.low else None), (high if high < edges.high else None)
        return replace(self, low=least, high=most, found=True)


def stable_ranges(trials: Trials, paths: Iterable[str] = ()) -> tuple[StableRange, ...]:
    """Return the nearest stable ranges over keys, by default knobs with a margin and `OTHERS`."""
    found = []
    for path in tuple(paths) or (*knobs_with_margin(trials.scene), *OTHERS):
        key = find_key(trials.scene, path)
        own = own_value(trials.scene, key)
        if own is None or not 0.0 < own < math.inf:
            continue
        one = StableRange(key.path, key.unit, own, own / REACH, own * REACH)
        try:
            one = one.nearest(_edges(trials, key.path, own))
        except OutOfWorkError:
            one = replace(one, reason="not searched: the work of the search was used up")
        except (InputError, NoVerdictError) as error:
            one = replace(one, reason=str(error))
        found.append(one)
    return tuple(found)


def _edges(trials: Trials, path: str, own: float) -> Edges:
    """Return the edges over a key; poles at samples decide where the loci leave a doubt."""
    exact = unrounded(trials.scene, path)

    def build(value: float) -> Circuit:
        return trials.board_at({**exact, path: value}).circuit

    boards = Family.over(build, path, own)
    if boards.ports is not None and boards.poles(own).certain:
        edges = find_edges(boards, own / REACH, own * REACH)
        if not edges.near:
            return edges
    values = np.geomspace(own / REACH, own * REACH, POINTS).tolist()
    return boards.scan(values)


LIMIT = 2000.0  # designs: the work of a search
SERIES = ("E24", "E96", "E192", "exact")
SUPPLIES = (5.0, 9.0, 12.0, 15.0, 18.0, 22.0)
SHOWN = 4  # op-amps that are proposed


@dataclass(frozen=True, slots=True)
class Change:
    """A change with which the state-space verdict is a pass."""

    DOCUMENT = ("values", "resistance [ohm]", "engine = 'statespace'")

    values: dict[str, Value]  # new values by dotted paths, with a lambda where it is held
    resistance: float | None = None  # R of the changed board where it differs from the scene's, ohm


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
        Those with which every check passes.
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
    """

    DOCUMENT = (
        *("failed", "stable_ranges = by_path", "stable_opamps = opamps", "changes", "without"),
        "not_searched = cut # these searches ended when the work was used up",
        *("searched", "unmendable", "trials", "undecided # why changes have no verdict"),
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

    @property
    def by_path(self) -> dict[str, StableRange]:
        """`stability` by the path of the key."""
        return {each.path: each for each in self.stability}


def mending_keys(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Return the keys that can mend each check; none mends a check that is not listed."""
    knobs = knobs_with_margin(scene)
    idle = {f"design.{key}" for key in topology_of(scene).unused}
    rest = ("unit_conductance", "gain", "lambda")
    mending = {
        **dict.fromkeys(("stability", *READINGS), (*knobs, OPAMP)),
        "steady_state": (
            *("design.resistor_series", "design.prune", OPAMP),
            *(f"design.{key}" for key in rest),
        ),
        "headroom": ("design.unit_voltage", OPAMP, "design.supply"),
        "noise": (OPAMP, *knobs, "design.unit_voltage"),
    }
    return {name: tuple(k for k in keys if k not in idle) for name, keys in mending.items()}


def find_remedies(
    verdict: Verdict, work: float = LIMIT, *, any_part: bool = False
) -> Remedies | None:
    """Return the nearest changes that mend a failed verdict, as `taction.what_to_change`."""
    failed = tuple(check.name for check in verdict.checks if check.outcome is Outcome.FAIL)
    if not failed:
        return None
    trials = Trials(verdict.scene, work, ANY_PART if any_part else None, rest_first=True)
    follows, keys = following(verdict.checks), mending_keys(verdict.scene)
    knobs = knobs_with_margin(verdict.scene)
    causes = [name for name in failed if name not in follows]
    unmendable = tuple(name for name in failed if name not in keys)
    paths = [] if unmendable else list(dict.fromkeys(p for name in causes for p in keys[name]))
    ranges = stable_ranges(trials, knobs) if verdict.poles.known_unstable and paths else ()
    begin = {each.path: each.edge for each in ranges}
    begin["design.unit_voltage"] = verdict.parts.largest_unit_voltage
    never = {each.path: each for each in ranges if not each.found and not each.reason}
    searches = [Search((path,), each.least, each.most) for path, each in never.items()]
    paths = [path for path in paths if path not in never]
    for place, path in enumerate(paths):
        share = 2.0 / (1 + len(paths) - place)  # the first keys, twice an equal part
        trials.limit = trials.spent + share * (work - trials.spent)
        searches += filter(None, [_search(trials, path, begin.get(path))])
    trials.limit = work
    transient = not unmendable and {*causes} <= {"stability", *READINGS}
    if transient and len(knobs) > 1 and not any(s.found for s in searches if s.paths[0] in knobs):
        searches += filter(None, [search_pair(trials, (knobs[0], knobs[1]))])
    stable = (t for t in trials.tried if t.passed("stability") and {OPAMP} == {*t.values})
    return Remedies(
        failed=failed,
        stability=ranges,
        changes=tuple(_change(trials, trial) for one in searches for trial in one.found[:SHOWN]),
        without=tuple(one for one in searches if one.complete and not one.found),
        searched=tuple(dict.fromkeys(path for one in searches for path in one.paths)),
        cut=tuple(one.paths for one in searches if not one.complete),
        unmendable=unmendable,
        opamps=tuple(str(trial.values[OPAMP]) for trial in stable) if ranges else (),
        trials=len(trials.tried),
        undecided=tuple(t.record.reason for t in trials.tried if t.record.outcome == ERROR),
    )


def _change(trials: Trials, trial: Trial) -> Change:
    values, resistance = trials.completed(trial.values), None
    if "design.lambda" in values:
        scene = trials.scene_at(trial.values)
        fact = topology_of(scene).facts(scene).get("R")
        resistance = None if fact is None else fact.value
    return Change(values, resistance)


def _search(trials: Trials, path: str, begin: float | None) -> Search | None:
    """Return the search over a key: over its list, the nearest first, or outwards."""
    design = trials.scene.design
    lists: dict[str, Sequence[Value]] = {
        "design.resistor_series": SERIES[SERIES.index(design.resistor_series) + 1 :],
        "design.prune": [design.prune / 3.0, design.prune / 10.0, 0.0] if design.prune else [],
        "design.supply": [volts for volts in SUPPLIES if volts > design.supply],
    }
    values = _opamps(trials.scene) if path == OPAMP else lists.get(path)
    if values is None:
        return search_key(trials, path, begin)
    rows = ({path: value} for value in values)
    return search(trials, Search((path,)), rows, math.inf) if values else None


def _opamps(scene: Scene) -> list[Value]:
    """Return the other presets, the one with the nearest bandwidth first; ideal: the fastest."""
    own, changed = choose_opamp(scene), scene.design.opamp

    def distance(name: str) -> float:
        gbw = OPAMPS[name].gbw
        return abs(math.log(gbw / own.gbw)) if math.isfinite(own.gbw) else -gbw

    others = (n for n in OPAMPS if n != changed.base or own.name != n)
    return [*sorted((n for n in others if math.isfinite(OPAMPS[n].gbw)), key=distance)]
