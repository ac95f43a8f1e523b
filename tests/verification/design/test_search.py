"""Searches over made-up boards whose accepted values are known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import cast

import pytest

from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.verification.design.search import search_list, search_pair, search_range
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


def test_the_nearest_value_of_three_digits() -> None:
    found = search_range(trials(lambda c, _: ["stable"] if c < 3.14159 else []), C)
    assert found.found.values == {C: 3.15e-11}


def test_the_nearest_value_of_a_series_below() -> None:
    slow = trials(lambda c, _: ["fast"] if c > 0.31 else [], series="E12")
    found = search_range(slow, C)
    assert found.found.values == {C: 2.7e-12}


def test_a_window_between_two_failures_of_different_checks() -> None:
    """It is 2 % wide; the values of the walk are 47 % apart."""

    def fails(c: float, _: float) -> list[str]:
        return ["stable"] if c < 5.0 else ["fast"] if c > 5.1 else []

    found = search_range(trials(fails), C)
    assert 5.0 <= float(found.found.values[C]) / 1e-11 <= 5.1


def test_a_value_between_one_that_rises_too_fast_and_one_that_rises_too_slowly() -> None:
    """The rise time is 1 us times C / 10 pF, and may lie between 3.3 us and 3.4 us."""
    found = search_range(cast("Trials", Rising(lambda c, _: _rise_fails(c))), C)
    assert found.found.values == {C: 3.3e-11}
    never = Rising(lambda c, _: [*_rise_fails(c), "fast"])
    assert search_range(cast("Trials", never), C).found is None
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
    assert found.found.values == {C: 4e-11}
    assert made.count < 12


def test_nothing_found_says_from_where_to_where() -> None:
    found = search_range(trials(lambda *_: ["fast"]), C)
    assert found.found is None
    assert (found.least, found.most) == pytest.approx((1e-13, 1e-9))
    assert found.complete


def test_time_that_ends_keeps_what_was_found() -> None:
    found = search_range(trials(lambda c, _: ["fast"] if c < 1.3 else [], most=3), C)
    assert found.found is not None
    assert not found.complete
    assert not search_pair(trials(lambda *_: ["fast"], most=5), (C, GAIN)).complete
    listed, accepted = search_list(trials(lambda *_: []), C, [1e-12, 2e-12])
    assert listed.complete
    assert len(accepted) == 2


def test_two_keys_where_neither_alone_does() -> None:
    """The disc of radius 0.3 decades around 10 times C and a tenth of the gain.

    The pairs that are tried first are a quarter of a decade apart.
    """

    def fails(c: float, s: float) -> list[str]:
        return [] if math.hypot(math.log10(c) - 1.0, math.log10(s) + 1.0) < 0.3 else ["fast"]

    found = search_pair(trials(fails), (C, GAIN)).found
    distance = math.hypot(
        math.log10(float(found.values[C]) / 1e-11), math.log10(float(found.values[GAIN]) / 1e6)
    )
    assert distance == pytest.approx(math.sqrt(2.0) - 0.3, abs=0.125)


def test_a_narrow_valley_between_two_checks() -> None:
    """C must be within 1 % of 3.3 times the gain's inverse, and the gain at most a half."""

    def fails(c: float, s: float) -> list[str]:
        if s > 0.5:
            return ["fast", "stable"]
        return ["stable"] if c * s < 3.3 else ["fast"] if c * s > 3.36 else []

    found = search_pair(trials(fails), (C, GAIN)).found
    product = float(found.values[C]) / 1e-11 * float(found.values[GAIN]) / 1e6
    assert 3.3 <= product <= 3.36


def test_a_key_without_a_value_is_left_out() -> None:
    made = trials(lambda *_: [])
    assert search_range(made, "design.stray_capacitance") is not None
    assert search_range(made, "design.prune") is None
