"""What to change on a board whose checks fail: the nearest changes that mend it, each verified.

Every failed check has its own keys (`mending_keys`). Over each key the search starts from the
scene's value and ends at the nearest value with which the state-space engine's verdict passes. What
an unstable board needs is solved on the poles first: the search begins at the edge of the stable
range. Where no single key mends a transient, two knobs are changed together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.part_warnings import ANY_PART
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.table import topology_of
from taction.system.reading_definitions import READINGS
from taction.verification.design.search import Searched, search_list, search_pair, search_range
from taction.verification.design.stable_ranges import StableRange, stable_ranges
from taction.verification.design.trials import OPAMP, Trial, Trials, knobs_with_margin
from taction.verification.verdict.cause import following
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import ERROR
from taction.verification.verdict.verify import Verdict

LIMIT = 3600.0  # designs: the work of a search
SERIES = ("E24", "E96", "E192", "exact")
SUPPLIES = (5.0, 9.0, 12.0, 15.0, 18.0, 22.0)
SHOWN = 4  # op-amps that are proposed


@dataclass(frozen=True, slots=True)
class Change:
    """A change with what the state-space verdict says about it.

    Attributes
    ----------
    values : dict
        New values by dotted paths, with a lambda where it is held.
    mends : tuple of str
        The failed checks that pass with the change.
    left : tuple of str
        The checks that do not pass; empty where the verdict is a pass.
    resistance : float or None
        R of the changed board where it differs from the scene's, ohm.
    """

    DOCUMENT = (
        *("values", "mends", "left # checks that do not pass with the change"),
        *("resistance [ohm]", "verified", "engine = 'statespace'"),
    )

    values: dict[str, Value]
    mends: tuple[str, ...]
    left: tuple[str, ...]
    resistance: float | None = None

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
    without : tuple of Searched
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
    without: tuple[Searched, ...]
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
    verdict: Verdict,
    work: float = LIMIT,
    *,
    any_part: bool = False,
) -> Remedies | None:
    """Return the nearest changes that mend a failed verdict; None for any other outcome.

    `work` and the errors are those of `taction.what_to_change`; the result is the same on every
    machine. Seven channels: 30 to 60 designs of 20 ms.
    """
    failed = tuple(check.name for check in verdict.checks if check.outcome is Outcome.FAIL)
    if not failed:
        return None
    trials = Trials(verdict.scene, work, ANY_PART if any_part else None)
    follows = following(verdict.checks)
    causes = tuple(name for name in failed if name not in follows)
    search = _RemedySearch(trials, failed, causes)
    if verdict.parts.largest_unit_voltage is not None:
        search.edges["design.unit_voltage"] = verdict.parts.largest_unit_voltage
    search.run(unstable=verdict.poles.known_unstable)
    return search.result()


class _RemedySearch:
    """A search in progress."""

    def __init__(self, trials: Trials, failed: tuple[str, ...], causes: tuple[str, ...]) -> None:
        self.trials, self.scene = trials, trials.scene
        self.keys, self.knobs = mending_keys(self.scene), knobs_with_margin(self.scene)
        self.failed, self.causes = failed, causes
        self.ranges: tuple[StableRange, ...] = ()
        self.edges: dict[str, float] = {}  # where a search begins, if not at the scene's value
        self.searched: list[Searched] = []
        self.passing: list[Trial] = []

    @property
    def paths(self) -> tuple[str, ...]:
        """The keys that can mend the failed checks, each once."""
        if any(name not in self.keys for name in self.failed):
            return ()
        return tuple(dict.fromkeys(path for name in self.causes for path in self.keys[name]))

    def run(self, *, unstable: bool) -> None:
        """Search over every key, then over C and the gain together."""
        paths = self.paths
        if unstable and paths:
            self.trials.share(2)
            self.ranges = stable_ranges(self.trials, self.knobs)
        known = {each.path: each for each in self.ranges}
        self.edges |= {path: one.edge for path, one in known.items() if one.edge is not None}
        for number, path in enumerate(paths):
            self.trials.share(len(paths) - number + 1)
            found = known.get(path)
            if found is not None and not found.found and not found.reason:
                self.searched.append(Searched((path,), None, found.least, found.most))
                continue
            self._over(path)
        single = any(set(self.knobs).intersection(t.values) for t in self.passing)
        transient = all(name in ("stability", *READINGS) for name in self.causes)
        if len(self.knobs) > 1 and transient and not single:
            self.trials.share(1)
            self._keep(search_pair(self.trials, self.knobs[:2]))
        self.trials.share(1)

    def _over(self, path: str) -> None:
        values = _listed(self.scene, path)
        if values is None:
            found = search_range(self.trials, path, self.edges.get(path))
            if found is not None:
                self._keep(found)
            return
        if not values:
            return
        listed, accepted = search_list(self.trials, path, values)
        self.searched.append(listed)
        self.passing += accepted[:SHOWN]

    def _keep(self, found: Searched) -> None:
        self.searched.append(found)
        if found.found is not None:
            self.passing.append(found.found)

    def result(self) -> Remedies:
        """Return what was found."""
        best = self.passing or self._partial()
        return Remedies(
            failed=self.failed,
            stability=self.ranges,
            changes=tuple(self._change(trial) for trial in best),
            without=tuple(s for s in self.searched if s.found is None and s.complete),
            searched=tuple(dict.fromkeys(path for s in self.searched for path in s.paths)),
            cut=tuple(s.paths for s in self.searched if not s.complete),
            unmendable=tuple(name for name in self.failed if name not in self.keys),
            opamps=self._stable_opamps() if self.ranges else (),
            trials=len(self.trials.tried),
            undecided=tuple(t.reason for t in self.trials.tried if t.outcome == ERROR),
            work=self.trials.spent,
            limit=self.trials.limit,
        )

    def _stable_opamps(self) -> tuple[str, ...]:
        stable = (t for t in self.trials.tried if t.passed("stability"))
        return tuple(str(t.values[OPAMP]) for t in stable if t.values.keys() == {OPAMP})

    def _partial(self) -> list[Trial]:
        """Return the trial nearest to the scene that mends most checks, for each set of keys."""
        mended: dict[tuple[str, ...], Trial] = {}
        for trial in self.trials.tried:
            paths, count = tuple(sorted(trial.values)), len(self._mends(trial))
            known = mended.get(paths)
            if count and not trial.refused and (known is None or count > len(self._mends(known))):
                mended[paths] = trial
        most = max((len(self._mends(trial)) for trial in mended.values()), default=0)
        return [trial for trial in mended.values() if len(self._mends(trial)) == most]

    def _mends(self, trial: Trial) -> tuple[str, ...]:
        """Return the failed checks that pass."""
        return tuple(name for name in self.failed if trial.passed(name))

    def _change(self, trial: Trial) -> Change:
        values = self.trials.completed(trial.values)
        resistance = None
        if "design.lambda" in values:
            resistance = self.trials.resistance_at(trial.values)
        return Change(values, self._mends(trial), trial.left, resistance)


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
