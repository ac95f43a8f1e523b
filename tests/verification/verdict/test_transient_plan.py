"""How long a board is simulated, and how finely."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.verdict.build import build
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.transient_plan import (
    UNSTABLE_SECONDS,
    TransientPlan,
    plan_transient,
    wanted_error,
)
from taction.verification.verdict.verify import verify
from tests.support.boards import paper_board
from tests.support.making import make_scene
from tests.support.paths import SCENES

SETTLING = 1.2 * math.log(1e4)  # time constants until a tenth of 1e-3 is left, and a fifth more


def planned(scene: Scene, **options: Any) -> tuple[TransientPlan, TimeScales]:
    board = LinearBoard(synthesise(scene))
    scales = time_scales(board, initial=scene.analysis.initial)
    return plan_transient(scene, board, scales, **options), scales


def breadboard(**values: Any) -> Scene:
    changed = {name.replace("__", "."): value for name, value in values.items()}
    return with_values(load_scene(SCENES / "paper-breadboard.toml"), changed)


def test_the_wanted_error_is_a_quarter_of_the_tightest_limit() -> None:
    checks = {"steady_state": {"tolerance": 1e-2}, "engines_agree": {"tolerance": 4e-2}}
    assert wanted_error(make_scene(checks=checks)) == pytest.approx(2.5e-3)
    band = checks | {"settling_time": {"band": 2e-3}}
    assert wanted_error(make_scene(checks=band)) == pytest.approx(5e-4)
    assert wanted_error(make_scene(checks=checks | {"overshoot": {"max": 0.0}})) == 2.5e-3
    assert wanted_error(make_scene(checks=checks | {"overshoot": {"max": 4e-4}})) == 1e-4
    assert wanted_error(make_scene(analysis={"error": 1e-7})) == 1e-7
    assert wanted_error(make_scene()) == pytest.approx(2.5e-4)


def test_the_stop_time_follows_the_slowest_mode() -> None:
    """Of the board at 1 nF and 100 kohm the signal nodes' own R and C are by far the slowest."""
    plan, scales = planned(breadboard(design__capacitance=1e-9, design__gain=1e5))
    slow = scales.amplitudes[scales.poles.real > -1e4].sum()
    longest = (SETTLING + 1.2 * math.log(max(slow, 1.0))) * scales.slowest
    assert 0.8 * longest < plan.transient.stop <= 1.01 * longest


def test_the_times_of_the_scene_are_kept() -> None:
    analysis = {"stop": 1 / 300, "initial": "rest", "points_per_period": 100}
    plan, scales = planned(make_scene(analysis=analysis))
    assert plan.transient.stop == 1 / 300
    assert plan.transient.initial == "rest"
    assert plan.transient.max_step == pytest.approx(scales.max_step_for(100), rel=1e-5)


def test_a_tighter_error_costs_more_steps_and_an_aim_replaces_it() -> None:
    loose, _ = planned(breadboard(design__capacitance=1e-10, analysis__error=1e-2))
    tight, _ = planned(breadboard(design__capacitance=1e-10, analysis__error=1e-4))
    assert loose.forecast.error <= 8e-3
    assert tight.forecast.error <= 8e-5
    assert tight.forecast.steps > 3 * loose.forecast.steps
    aimed, _ = planned(breadboard(design__capacitance=1e-10, analysis__error=1e-2), aim=8e-5)
    assert aimed.forecast.steps == tight.forecast.steps
    assert aimed.wanted == 1e-2


def test_an_unstable_board_gets_the_time_to_show_it_and_no_more() -> None:
    plan, scales = planned(breadboard(design__capacitance=5e-12))
    assert plan.growing
    assert plan.transient.stop == pytest.approx(scales.growth_time, rel=1e-5)
    assert plan.seconds <= UNSTABLE_SECONDS
    assert plan.notes == ()


def test_an_instability_too_slow_to_be_seen_is_not_waited_for() -> None:
    """1e-5 inside the edge of oscillation, the ringing grows over a million of periods."""
    plan, scales = planned(breadboard(design__capacitance=9.0224e-12 * (1 - 1e-5)))
    assert scales.growth_time < math.inf
    assert plan.seconds <= 1.1 * UNSTABLE_SECONDS
    (note,) = plan.notes
    assert "before the instability has grown" in note
    assert plan.transient.stop < scales.growth_time


@pytest.mark.parametrize("share", [1e-2, 1e-5])
def test_a_growing_record_of_the_exact_engine_shows_every_period(share: float) -> None:
    scene = breadboard(design__capacitance=9.0224e-12 * (1 - share))
    plan, scales = planned(scene, steps=False)
    period = scales.max_step_for(1.0)
    assert plan.growing
    assert plan.transient.max_step <= period / 8
    assert plan.transient.stop <= 20_001 * period
    assert bool(plan.notes) == (plan.transient.stop < 0.999 * scales.growth_time)


def test_the_coarse_image_of_a_large_board_does_not_decide_whether_the_outputs_grow() -> None:
    """At 2 pF the image of these 64 channels is unstable, and the board itself is stable."""
    problem = {"channels": 64, "span": 16.0, "quadrature": "rectangle"}
    design = {
        "capacitance": 2e-12,
        "gain": 5e5,
        "unit_conductance": 2e-6,
        "lambda": 0.1,
        "opamp": "tl084",
        "stray_capacitance": 2e-12,
    }
    asked = make_scene(problem, design=design, analysis={"engine": "ngspice"})
    found = build(asked)
    assert not found.scales.complete
    assert found.scales.growth_time < math.inf
    assert found.poles.stable
    assert not found.plan.growing
    assert found.plan.notes == ()
    slowest = -1.0 / found.poles.rightmost.real
    assert found.transient.stop > 4.0 * slowest


def test_a_slower_pole_of_a_large_board_makes_its_record_longer() -> None:
    coarse = replace(time_scales(paper_board()), complete=False)
    rate = 0.1 / coarse.slowest
    slower = coarse.with_slower(complex(-rate))
    assert slower.stop_for(1e-4) == pytest.approx(math.log(1e4) / rate, rel=1e-2)
    assert coarse.with_slower(complex(-0.9 / coarse.slowest)) is coarse
    assert coarse.with_slower(complex(rate)) is coarse
    whole = time_scales(paper_board())
    assert whole.with_slower(complex(-rate)) is whole


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("force", [10.0, 30.0])
def test_steps_follow_a_board_to_a_rest_where_all_amplifiers_saturate(force: float) -> None:
    """Its modes at rest are those of the signal nodes alone; on the way there it rings."""
    scene = with_values(load_scene(SCENES / "box.toml"), {"problem.load.force": force})
    board = LinearBoard(synthesise(scene))
    scales = time_scales(board, initial=scene.analysis.initial)
    assert plan_transient(scene, board, scales).forecast.steps > 500  # by the modes at rest 70
    found = {check.name: check for check in verify(scene.with_engine("ngspice")).checks}
    assert np.abs(board.equilibrium.slopes).max() < 1e-9
    assert found["engines_agree"].outcome is Outcome.PASS
