"""What to change on a board whose checks fail: the nearest changes that mend it, each verified.

Every failed check has its own keys (`mending_keys`). Over each key one loop goes outwards from the
scene's value to the first value with which the state-space engine's verdict passes. Lambda, and
with it the solution, stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.reading_definitions import READINGS
from taction.verification.design.trials import OPAMP, Search, Trial, Trials, search
from taction.verification.verdict.checks import Outcome, following
from taction.verification.verdict.record import ERROR
from taction.verification.verdict.verify import Verdict

LIMIT = 2000.0  # designs: the work of a search
SERIES = ("E24", "E96", "E192", "exact")
SUPPLIES = (5.0, 9.0, 12.0, 15.0, 18.0, 22.0)
SHOWN = 4  # op-amps that are proposed


@dataclass(frozen=True, slots=True)
class Change:
    """A change with which the state-space verdict is a pass."""

    DOCUMENT = ("values", "resistance [ohm]", "engine")

    values: dict[str, Value]  # new values by dotted paths, with a lambda where it is held
    resistance: float | None = None  # R of the changed board where it differs from the scene's, ohm
    engine: str = "statespace"  # that found the pass


@dataclass(frozen=True, slots=True)
class Remedies:
    """The changes that were found for a verdict that fails."""

    DOCUMENT = (
        *("failed", "changes", "searched = searches", "unmendable", "trials"),
        "undecided # why changes have no verdict",
    )

    failed: tuple[str, ...]  # checks
    changes: tuple[Change, ...]  # with which every check passes
    searches: tuple[Search, ...]  # the keys that were searched, each with the ends of its values
    unmendable: tuple[str, ...]  # failed checks that no change of the design mends
    trials: int  # changes that were judged
    undecided: tuple[str, ...]  # why some of them have no verdict, a reason for each


def mending_keys(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Return the keys that can mend each check; none mends a check that is not listed."""
    topology = topology_of(scene)
    knobs = tuple(knob.key for knob in topology.knobs(scene) if knob.margin)
    idle = {f"design.{key}" for key in topology.unused}
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


def find_remedies(verdict: Verdict, work: float = LIMIT) -> Remedies | None:
    """Return the nearest changes that mend a failed verdict, as `taction.what_to_change`."""
    failed = tuple(check.name for check in verdict.checks if check.outcome is Outcome.FAIL)
    if not failed:
        return None
    trials = Trials(verdict.scene, work, rest_first=True)
    follows, keys = following(verdict.checks), mending_keys(verdict.scene)
    causes = [name for name in failed if name not in follows]
    unmendable = tuple(name for name in failed if name not in keys)
    paths = [] if unmendable else list(dict.fromkeys(p for name in causes for p in keys[name]))
    searches = list[Search]()
    for place, path in enumerate(paths):
        share = 2.0 / (1 + len(paths) - place)  # the first keys, twice an equal part
        trials.limit = trials.spent + share * (work - trials.spent)
        searches += filter(None, [_search(trials, path)])
    return Remedies(
        failed=failed,
        changes=tuple(_change(trials, trial) for one in searches for trial in one.found[:SHOWN]),
        searches=tuple(searches),
        unmendable=unmendable,
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


def _search(trials: Trials, path: str) -> Search | None:
    """Return the search over a key: over its list, the nearest first, or outwards."""
    design = trials.scene.design
    lists: dict[str, Sequence[Value]] = {
        "design.resistor_series": SERIES[SERIES.index(design.resistor_series) + 1 :],
        "design.prune": [design.prune / 3.0, design.prune / 10.0, 0.0] if design.prune else [],
        "design.supply": [volts for volts in SUPPLIES if volts > design.supply],
    }
    return search(trials, path, _opamps(trials.scene) if path == OPAMP else lists.get(path))


def _opamps(scene: Scene) -> list[Value]:
    """Return the other presets, the one with the nearest bandwidth first; ideal: the fastest."""
    own, changed = choose_opamp(scene), scene.design.opamp

    def distance(name: str) -> float:
        gbw = OPAMPS[name].gbw
        return abs(math.log(gbw / own.gbw)) if math.isfinite(own.gbw) else -gbw

    others = (n for n in OPAMPS if n != changed.base or own.name != n)
    return [*sorted((n for n in others if math.isfinite(OPAMPS[n].gbw)), key=distance)]
