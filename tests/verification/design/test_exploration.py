"""Values of an exploration, and searches over boards whose accepted values are known."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.axes import with_settings
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import InputError
from taction.verification.design.exploration import (
    judge,
    view_boundary,
    view_limits,
    view_poles,
    view_rest,
)
from taction.verification.design.explorer_settings import (
    LAMBDA,
    STRAY,
    VARIANCE,
    Settings,
    Start,
    read_value,
)
from taction.verification.design.search import search_list, search_pair, search_range
from taction.verification.design.trials import OutOfWorkError, Trial, Trials
from tests.support.making import make_scene
from tests.support.paths import SCENES
from tests.support.trials import make_trial

ONE = {
    "name": "one",
    "problem": {"kind": "tactile", "channels": 1, "depth": 1.0},
    "design": {
        "opamp": {"base": "ideal", "dc_gain": 1e6, "gbw": "1GHz"},
        "capacitance": "1nF",
        "gain": "1Mohm",
        "lambda": 0.5,
        "stray_capacitance": "0F",
    },
}
CAPACITANCE, GAIN = "design.capacitance", "design.gain"
BREADBOARD = SCENES / "paper-breadboard.toml"


@pytest.fixture
def start() -> Start:
    return Start.of(load_scene(BREADBOARD))


def test_one_channel_rises_as_its_closed_form() -> None:
    """One ideal channel has ``u = u0 (1 - exp(-t/tau))``, tau = RC / (1 + T² / lambda)."""
    start = Start.of(parse_scene(ONE, "one.toml"))
    view = view_rest(start.scene, start.problem)
    T, eps = float(start.problem.matrix[0, 0]), float(start.problem.strain[0])
    u0 = T * eps / (T**2 + 0.5)
    assert view.targets == pytest.approx([u0], rel=1e-12)
    assert view.rest == pytest.approx([u0], rel=1e-4)
    value = view.board.circuit.value
    tau = value("R") * value("C") / (1.0 + T**2 / 0.5)
    response = view_poles(view).response
    curves = response.curves(response.rise)
    expected = u0 * (1.0 - np.exp(-curves.time / tau))
    assert curves.outputs[:, 0] == pytest.approx(expected, abs=5e-3 * abs(u0))
    assert response.rise == pytest.approx(6.0 * math.log(10.0) * tau, rel=0.1)
    assert len(curves.time) >= 500


def test_the_boundary_is_that_of_onset(start: Start) -> None:
    control = start.control(CAPACITANCE)
    view = view_rest(start.scene, start.problem)
    found = view_boundary(view, view_poles(view), "C", control.low, control.high)
    onset = taction.onset(start.scene, over="C=1pF:300pF", transients=False)
    edge = max(each.crossing.value for each in onset.findings)  # below it more poles cross
    assert [low for low, _ in found.stable_ranges] == pytest.approx([edge], rel=1e-6)
    assert found.stable_ranges[-1][1] == pytest.approx(control.high, rel=1e-12)


def test_the_boundary_is_the_same_from_an_unstable_board(start: Start) -> None:
    control = start.control(CAPACITANCE)
    edges = []
    for value in (5e-12, 1e-11, 1e-10):
        settings = Settings.of(start, {CAPACITANCE: value})
        view = view_rest(settings.scene(start), start.problem)
        found = view_boundary(view, view_poles(view), "C", control.low, control.high)
        edges.append(found.stable_ranges[0][0])
    assert edges == pytest.approx([edges[1]] * 3, rel=1e-6)


def test_an_unstable_board_says_so(start: Start) -> None:
    settings = Settings.of(start, {CAPACITANCE: 5e-12})
    view = view_rest(settings.scene(start), start.problem)
    poles = view_poles(view)
    assert poles.state == "unstable"
    assert "unstable" in poles.doubts[0]
    assert view_limits(view, poles) == ()
    assert np.abs(poles.response.curves(poles.response.stop).outputs).max() > 1.0


def test_op_amps_that_cannot_follow_are_named() -> None:
    start = Start.of(load_scene(SCENES / "custom-matrix.toml"))
    view = view_rest(start.scene, start.problem)
    assert view_limits(view, view_poles(view)) == ()
    scene = with_settings(start.scene, ["design.opamp.slew_rate=0.001V/us"])
    view = view_rest(scene, start.problem)
    poles = view_poles(view)
    assert poles.state == "stable"
    (text,) = view_limits(view, poles)
    assert "slope of op-amp" in text


def test_the_gain_leaves_lambda(start: Start) -> None:
    settings = Settings.of(start, {GAIN: 3e6})
    before, after = (
        view_rest(start.scene, start.problem),
        view_rest(settings.scene(start), start.problem),
    )
    assert after.targets == pytest.approx(before.targets, rel=1e-9)
    assert settings.changes(start)[LAMBDA] == start.control(LAMBDA).own


def test_the_scene_itself_has_no_changes(start: Start) -> None:
    own = {control.path: control.own for control in start.controls}
    settings = Settings.of(start, own)
    assert settings.changes(start) == {}
    assert settings.scene(start) is start.scene


def test_noise_changes_the_strain(start: Start) -> None:
    settings = Settings.of(start, {VARIANCE: 1e-4})
    scene = settings.scene(start)
    noisy = settings.problem(start, scene)
    assert 0.0 < np.abs(noisy.strain - start.problem.strain).max() < 0.1
    assert Settings().problem(start, start.scene) is start.problem


def test_the_command_has_the_present_values(start: Start) -> None:
    values = {CAPACITANCE: 1.234e-11, GAIN: 5e6, STRAY: 0.0, VARIANCE: 1e-5}
    settings = Settings.of(start, values, "tl084")
    words = settings.command(start).split()
    given = [word for before, word in pairwise(words) if before == "--set"]
    scene = with_settings(load_scene(BREADBOARD), given)
    assert scene.model_dump() == settings.scene(start).model_dump()


def test_a_saved_scene_reads_as_the_values(start: Start, tmp_path: Path) -> None:
    file = tmp_path / "board.toml"
    file.write_text(BREADBOARD.read_text("utf-8"), encoding="utf-8")
    start = Start.of(load_scene(file))
    settings = Settings.of(start, {CAPACITANCE: 2e-11, LAMBDA: 0.5})
    saved = settings.save(start, "new.toml")
    assert saved == tmp_path / "new.toml"
    assert load_scene(saved).model_dump() == settings.scene(start).model_dump()
    expected = judge(settings.scene(start), "statespace", 100).record
    found = judge(load_scene(saved), "statespace", 100).record
    assert found.value("settling_time") == expected.value("settling_time")


@pytest.mark.parametrize(
    "name",
    [
        "board.toml",
        "../new.toml",
        "new",
        ".toml",
        "",
        "a/b.toml",
        "a\n.toml",
        "a b.toml",
        "é.toml",
        "\x1b.toml",
        "::x.toml",
        "x" * 65 + ".toml",
        "a\x00.toml",
    ],
)
def test_a_file_is_never_replaced(tmp_path: Path, name: str) -> None:
    file = tmp_path / "board.toml"
    text = BREADBOARD.read_text("utf-8")
    file.write_text(text, encoding="utf-8")
    start = Start.of(load_scene(file))
    with pytest.raises(InputError):
        Settings.of(start, {CAPACITANCE: 2e-11}).save(start, name)
    assert file.read_text("utf-8") == text
    assert list(tmp_path.iterdir()) == [file]


def test_sliders_are_logarithmic_and_find_the_scene(start: Start) -> None:
    for control in start.controls:
        assert control.chosen(control.place(control.own)) == control.own
        assert control.value(1.0) == control.high
        middle = control.value(0.5 + 0.5 * (0.04 if control.has_zero else 0.0))
        assert middle == pytest.approx(math.sqrt(control.low * control.high))
        assert control.place(2.0 * control.high) == 1.0
    assert start.control(CAPACITANCE).chosen(0.0) == pytest.approx(1e-11 / 30.0, rel=1e-3)
    assert start.control(VARIANCE).chosen(0.0) == 0.0


def test_typed_values(start: Start) -> None:
    assert read_value(start.control(CAPACITANCE), " 12p ") == 1.2e-11
    assert read_value(start.control(GAIN), "5 MΩ") == 5e6
    assert read_value(start.control(LAMBDA), "0.25") == 0.25
    for path, text in ((CAPACITANCE, "12 ohm"), (LAMBDA, "a"), (LAMBDA, "inf"), (GAIN, "")):
        with pytest.raises(InputError):
            read_value(start.control(path), text)


def test_a_verdict_is_that_of_verify(start: Start) -> None:
    scene = Settings.of(start, {CAPACITANCE: 1.5e-11}).scene(start)
    found, verdict = judge(scene, "statespace", 200), taction.verify(scene, engine="statespace")
    assert found.record.value("settling_time") == verdict.measurements.settling_time.value
    assert found.record.outcome == verdict.outcome.value
    for column, whole in zip(found.curves.outputs.T, verdict.u.T, strict=True):
        assert (column.min(), column.max()) == (whole.min(), whole.max())


def test_a_closed_loop_board_has_its_own_slider_and_its_whole_margin() -> None:
    """The stable values of gf and the margin of the verdict are two searches with one edge."""
    scene = load_scene(SCENES / "least-squares.toml")
    start = Start.of(scene)
    assert start.controls[0].name == "feedback conductance"
    view = view_rest(start.scene, start.problem)
    stable = view_boundary(view, view_poles(view), "gf", 2e-5, 1.8e-2).stable_ranges
    found = judge(start.scene, "statespace", 500)
    margin = found.record.value("margin")
    assert margin == pytest.approx(start.controls[0].own / stable[-1][0], rel=1e-6)
    assert margin is not None
    assert margin > scene.checks.stability.margin


def test_a_verdict_that_cannot_be_had_says_why() -> None:
    data = {**ONE, "problem": {"kind": "matrix", "matrix": "none.csv", "strain": "none.csv"}}
    found = judge(parse_scene(data, "none.toml"), "statespace", 100)
    assert found.record.outcome == "error"
    assert "none.csv" in found.record.reason


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
