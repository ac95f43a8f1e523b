"""Values of an exploration, and what to change: every proposal verified again."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import Point, with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.verification.design import trials
from taction.verification.design.exploration import LAMBDA, BoardView, Settings, judge
from taction.verification.design.remedies import Remedies, find_remedies
from taction.verification.design.trials import OutOfWorkError, Trials
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.report.views.design_view import remedies_text
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene
from tests.support.paths import SCENES

FAST = {"base": "ideal", "dc_gain": 1e6, "gbw": "1GHz"}
ONE = {"capacitance": "1nF", "gain": "1Mohm", "lambda": 0.5, "stray_capacitance": 0, "opamp": FAST}
CAPACITANCE, GAIN = "design.capacitance", "design.gain"
BREADBOARD = SCENES / "paper-breadboard.toml"
LONG = 1e6  # designs


@pytest.fixture
def start() -> Settings:
    return Settings.of(load_scene(BREADBOARD))


def test_one_channel_rises_as_its_closed_form() -> None:
    """One ideal channel has ``u = u0 (1 - exp(-t/tau))``, tau = RC / (1 + T² / lambda)."""
    start = Settings.of(make_scene({"channels": 1, "depth": 1.0}, design=ONE))
    view = BoardView(start.original)
    T, eps = float(view.problem.matrix[0, 0]), float(view.problem.strain[0])
    u0 = T * eps / (T**2 + 0.5)
    assert view.answer.target == pytest.approx([u0], rel=1e-12)
    assert view.rest == pytest.approx([u0], rel=1e-4)
    value = view.board.circuit.value
    tau = value("R") * value("C") / (1.0 + T**2 / 0.5)
    curves = view.curves("rise")
    expected = u0 * (1.0 - np.exp(-curves.time / tau))
    assert curves.outputs[:, 0] == pytest.approx(expected, abs=5e-3 * abs(u0))
    assert curves.windows["rise"] == pytest.approx(6.0 * math.log(10.0) * tau, rel=0.1)
    assert len(curves.time) >= 500


def test_the_boundary_is_that_of_onset_from_a_stable_and_an_unstable_board(start: Settings) -> None:
    control = start.control(CAPACITANCE)
    onset = taction.onset(start.original, over="C=5pF:20pF", transients=False)
    edge = max(each.crossing.value for each in onset.findings)  # below it more poles cross
    for value in (5e-12, 1e-10):
        view = BoardView(start.moved({CAPACITANCE: value}).scene())
        found = view.boundary("C", control.low, control.high)
        assert [low for low, _ in found.stable_ranges] == pytest.approx([edge], rel=1e-6)
        assert found.stable_ranges[-1][1] >= control.high * (1.0 - 1e-12)


def test_op_amps_that_cannot_follow_are_named() -> None:
    scene = load_scene(SCENES / "custom-matrix.toml")
    assert BoardView(scene).limits() == ()
    view = BoardView(with_values(scene, {"design.opamp.slew_rate": 1e3}))
    assert view.poles.known_stable
    (text,) = view.limits()
    assert "slope of op-amp" in text


def test_a_moved_board_keeps_lambda_and_has_the_verdict_of_verify(start: Settings) -> None:
    settings = start.moved({GAIN: 3e6})
    before, after = BoardView(start.original), BoardView(settings.scene())
    assert after.answer.target == pytest.approx(before.answer.target, rel=1e-9)
    assert settings.changes()[LAMBDA] == start.control(LAMBDA).own
    scene = start.moved({CAPACITANCE: 1.5e-11}).scene()
    found, verdict = judge(scene), taction.verify(scene, engine="statespace")
    assert found.record.value("settling_time") == verdict.measurements.settling_time.value
    assert found.record.outcome == verdict.outcome.value
    for column, whole in zip(found.curves.outputs.T, verdict.u.T, strict=True):
        assert (column.min(), column.max()) == (whole.min(), whole.max())


def test_a_closed_loop_board_has_its_own_slider_and_its_whole_margin() -> None:
    """The stable values of gf and the margin of the verdict are two searches with one edge."""
    scene = load_scene(SCENES / "least-squares.toml")
    start = Settings.of(scene)
    assert start.controls[0].name == "feedback conductance"
    view = BoardView(start.original)
    stable = view.boundary("gf", 2e-5, 1.8e-2).stable_ranges
    found = judge(start.original)
    margin = found.record.value("margin")
    assert margin == pytest.approx(start.controls[0].own / stable[-1][0], rel=1e-6)
    assert margin is not None
    assert margin > scene.checks.stability.margin


def paper(changes: Point | None = None, name: str = "paper-breadboard") -> Scene:
    scene = load_scene(SCENES / f"{name}.toml").with_engine("statespace")
    return with_values(scene, changes or {})


@cache
def unstable() -> tuple[Scene, Remedies]:
    scene = paper({"design.capacitance": 5e-12})
    found = find_remedies(verify(scene), LONG)
    assert found is not None
    return scene, found


def test_every_change_of_an_unstable_board_passes_the_whole_verdict() -> None:
    scene, found = unstable()
    assert found.changes
    for change in found.changes:
        verdict = verify(with_values(scene, change.values))
        assert verdict.outcome.value == "pass"
        assert verdict.circuit.value("lambda") == pytest.approx(0.7669809, rel=1e-6)  # of the scene
    none = find_remedies(verify(scene), 1e-9)  # a limit of the work says what it left out
    assert none.trials == 0
    assert not any(each.complete for each in none.searches)
    text = "searched 0 changes of C, gain, opamp; not to the end: C, gain, opamp"
    assert text in remedies_text(scene, none)


@pytest.mark.parametrize("more", [{"design.gain": 6e6}, {"design.capacitance": 1e-12}])
def test_a_rise_between_too_fast_and_too_slow_is_found(more: Point) -> None:
    """At 8.5 pF the board of the paper is too fast, and at 12.5 pF too slow; 1 pF steps over it."""
    scene = paper({"design.capacitance": 8e-12, **more})
    found = find_remedies(verify(scene), LONG)
    (farads,) = found.changes[0].values.values()
    assert 8.53e-12 < float(farads) < 1.25e-11
    for change in found.changes:
        verdict = verify(with_values(scene, change.values))
        assert verdict.outcome.value == "pass"


def test_a_limit_on_the_settling_time_and_rounded_resistors_are_named() -> None:
    scene = paper({"design.capacitance": 1e-10}, "tuned-breadboard")
    text = remedies_text(scene, find_remedies(verify(scene), LONG))
    assert "C = 74.5 pF (verified)" in text  # the largest that passes is 77.3 pF
    scene = paper({"design.resistor_series": "E24"}, "tuned-breadboard")
    found = find_remedies(verify(scene), 600.0)
    assert found.changes[0].values == {"design.resistor_series": "exact"}


def test_the_work_is_counted_and_kept() -> None:
    scene = paper({"design.capacitance": 5e-12})
    found, again = (find_remedies(verify(scene), 60.0) for _ in range(2))
    assert found == again
    assert not found.searches[-1].complete
    trials = Trials(scene, 20.0)
    board = LinearBoard(synthesise(scene))
    with pytest.raises(OutOfWorkError):
        trials.spend(20.0, board)
    trials.spend(1.0, board)
    assert trials.spent == 1.0 + (board.state_space.n / 70.0) ** 3


def test_the_reason_of_boards_that_ring_too_long_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trials, "LONGEST", 1.0)
    made = Trials(paper(name="paper-exponential"))
    found = made.at({"design.capacitance": 5e-11})
    assert found.record.figures["settling_time"] is None
    assert "it rings too long for a search" in found.record.reason
    scene, remedies = unstable()
    shown = remedies_text(scene, replace(remedies, undecided=(found.record.reason,)))
    assert f"1 of them without a verdict, such as: {found.record.reason}" in shown
