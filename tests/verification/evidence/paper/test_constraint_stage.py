"""The constraint stage alone, with closed forms of one and two poles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.verification.evidence.paper.constraint_stage import constraint_plane
from tests.support.paths import SCENES


@pytest.fixture
def circuit():
    scene = load_scene(SCENES / "paper-breadboard.toml")
    return synthesise(scene, make_problem(scene))


def with_models(circuit, **figures):
    models = {name: replace(model, **figures) for name, model in circuit.models.items()}
    return replace(circuit, models=models)


def noise_gain(circuit, row):
    return 1.0 + circuit.value("gain") * np.sum(1.0 / circuit.forward.ohms[row - 1])


def test_one_pole_rises_in_its_closed_loop_time_constant(circuit):
    """Without a second pole the stage is a lag of noise gain / (2 pi GBW), but for 1/A0."""
    single = with_models(circuit, second_pole=np.inf, output_resistance=0.0)
    found = constraint_plane(single)
    lag = noise_gain(circuit, found.row) / (2 * np.pi * 718e3)
    assert found.amplifier_rise_time == pytest.approx(np.log(9) * lag, rel=1e-4)


def test_the_stage_with_its_capacitance_is_a_second_order_system(circuit):
    """One pole w = 2 pi GBW and C at the node: p² C s/w + p (noise gain)/w + 1."""
    single = with_models(circuit, second_pole=np.inf, output_resistance=0.0, dc_gain=1e9)
    found = constraint_plane(single)
    w, gain = 2 * np.pi * 718e3, circuit.value("gain")
    square, linear = 13e-12 * gain / w, noise_gain(circuit, found.row) / w
    damping = linear / (2 * np.sqrt(square))
    overshoot = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert found.stage_overshoot == pytest.approx(overshoot, rel=1e-3)
    assert found.stage_rise_time > found.amplifier_rise_time


def test_a_stage_that_oscillates_by_itself_has_no_rise_time(circuit):
    # Three lags in the loop: the op-amp's integrator (90 degrees), its second pole at 1 kHz and
    # the summing node's at 2 kHz (over 80 degrees each where the loop gain is 1, at some 9 kHz).
    found = constraint_plane(with_models(circuit, second_pole=1e3))
    assert (found.stage_rise_time, found.stage_overshoot) == (None, None)
    assert 0.0 < found.amplifier_rise_time < 1e-5


def test_the_papers_figure(circuit):
    assert constraint_plane(circuit).amplifier_rise_time == pytest.approx(1.0e-6, rel=0.01)
