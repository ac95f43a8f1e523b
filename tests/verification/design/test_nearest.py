"""Searches over boards whose accepted values are known."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.verification.design.nearest import Search, search_key, search_list, search_pair
from taction.verification.design.trials import OutOfWorkError, Trial, Trials
from tests.support.making import make_scene
from tests.support.trials import make_trial

C, GAIN = "design.capacitance", "design.gain"
Fails = Callable[[float, float], list[str]]  # of C / 10 pF and gain / 1 Mohm


@dataclass
class MadeUp:
    """Trials that fail the checks that a function names; `most` trials fit into the time."""

    fails: Fails
    most: int = 10_000
    series: str = "exact"
    count: int = 0
    tried: list[Mapping[str, Value]] = field(default_factory=list)

    @property
    def scene(self) -> Scene:
        design = {"capacitance": 1e-11, "gain": 1e6, "capacitor_series": self.series}
        return make_scene(design=design)

    def at(self, changes: Mapping[str, Value]) -> Trial:
        self.count += 1
        self.tried.append(changes)
        if self.count > self.most:
            raise OutOfWorkError
        farads, ohms = float(changes.get(C, 1e-11)), float(changes.get(GAIN, 1e6))
        failed = self.fails(farads / 1e-11, ohms / 1e6)
        return make_trial(changes, left=failed)


def trials(fails: Fails, **more: int | str) -> Trials:
    return cast("Trials", MadeUp(fails, **more))  # type: ignore[arg-type]


def search_range(made: Trials, path: str, **options: Any) -> Search | None:
    """The finished search over one key."""
    return search_key(made, path, **options)


def value_of(found: Search | None, path: str = C) -> float:
    (trial,) = found.found
    return float(trial.values[path])


def test_the_nearest_value_of_three_digits() -> None:
    found = search_range(trials(lambda c, _: ["stable"] if c < 3.14159 else []), C)
    assert value_of(found) == 3.15e-11


def test_a_window_between_two_failures_of_different_checks() -> None:
    """It is 2 % wide; the values of the walk are half a decade apart."""

    def fails(c: float, _: float) -> list[str]:
        return ["stable"] if c < 5.0 else ["fast"] if c > 5.1 else []

    found = search_range(trials(fails), C)
    assert 5.0 <= value_of(found) / 1e-11 <= 5.1


def test_a_value_between_one_that_rises_too_fast_and_one_that_rises_too_slowly() -> None:
    """The rise time is 1 us times C / 10 pF, and may lie between 3.3 us and 3.4 us."""
    found = search_range(cast("Trials", Rising(lambda c, _: _rise_fails(c))), C)
    assert value_of(found) == 3.3e-11
    never = Rising(lambda c, _: [*_rise_fails(c), "fast"])
    assert search_range(cast("Trials", never), C).found == []
    assert never.count < 100


class Rising(MadeUp):
    """Trials with a rise time of 1 us times C / 10 pF, of which the scene limits both sides."""

    @property
    def scene(self) -> Scene:
        limits = {"rise_time": {"min": "3.3us", "max": "3.4us"}}
        return make_scene(design={"capacitance": 1e-11, "gain": 1e6}, checks=limits)

    def at(self, changes: Mapping[str, Value]) -> Trial:
        trial = super().at(changes)
        rise = 1e-6 * float(changes.get(C, 1e-11)) / 1e-11
        checks = [
            replace(check, value=rise) if check.name == "rise_time" else check
            for check in trial.record.checks
        ]
        return replace(trial, record=replace(trial.record, checks=tuple(checks)))


def _rise_fails(c: float) -> list[str]:
    return [] if 3.2999 < c < 3.4001 else ["rise_time"]


def test_the_walk_from_an_edge_goes_away_from_the_scene() -> None:
    made = MadeUp(lambda c, _: ["stable"] if c < 4.0 else [])
    found = search_range(cast("Trials", made), C, edge=4e-11)
    assert value_of(found) == 4e-11
    assert made.count < 16


def test_work_that_ends_keeps_what_was_found() -> None:
    found = search_range(trials(lambda c, _: ["fast"] if c < 1.3 else [], most=3), C)
    assert found.found
    assert not found.complete
    assert not search_pair(trials(lambda *_: ["fast"], most=5), (C, GAIN)).complete
    made = trials(lambda c, _: ["fast"] if c > 0.16 else [])
    listed = search_list(made, C, [1e-12, 2e-12, 1.5e-12])
    assert listed.complete
    assert [trial.values[C] for trial in listed.found] == [1e-12, 1.5e-12]


class Sloping(MadeUp):
    """Trials whose settling time is 1 us times C times gain, and the overshoot 1 over C."""

    @property
    def limits(self) -> dict[str, float]:
        return {"settling_time": 1e-6, "overshoot": 0.2}

    def at(self, changes: Mapping[str, Value]) -> Trial:
        c, s = float(changes[C]) / 1e-11, float(changes[GAIN]) / 1e6
        values = {"settling_time": 1e-6 * c * s, "overshoot": 1.0 / c}
        self.fails = lambda *_: [n for n, value in values.items() if value > self.limits[n]]
        trial = super().at(changes)
        checks = [
            replace(check, value=values[check.name], expected=self.limits[check.name])
            for check in trial.record.checks
            if check.name in values
        ]
        record = replace(trial.record, checks=tuple(checks), stable=True)
        return replace(trial, record=record)


def test_two_keys_where_neither_alone_does() -> None:
    """C must be 5 times the scene's, and the gain a fifth at most: 0.99 decades away."""
    (found,) = search_pair(cast("Trials", Sloping(lambda *_: [])), (C, GAIN)).found
    c, s = float(found.values[C]) / 1e-11, float(found.values[GAIN]) / 1e6
    assert c >= 5.0
    assert c * s <= 1.0
    assert math.hypot(math.log10(c), math.log10(s)) < 1.4
