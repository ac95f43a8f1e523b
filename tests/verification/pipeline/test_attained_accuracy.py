"""A scene that asks for an error: the step beforehand, what a second run says, one refinement."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from netlist_gen.scene.file import load_scene
from netlist_gen.scene.scene import Scene
from spice_models.errors import InputError
from tests.support.making import make_scene
from tests.support.paths import SCENES
from verification.engines.statespace.transients.exact import exact_solution
from verification.pipeline import transient_plan
from verification.pipeline.attained_accuracy import Accuracy, both_tries, finer
from verification.pipeline.clock import Clock
from verification.pipeline.design import design_board
from verification.pipeline.simulation import choose_engine, outputs, state_space_tolerance
from verification.pipeline.transient_plan import FEWEST_PER_PERIOD, plan_transient, step_for_error
from verification.report.verdict.json_document import verdict_document
from verification.small_signal.time_scales import Ringing, TimeScales
from verification.verify import verify

DECAY, OMEGA = 1e3, 2e5


def one_mode(amplitude: float = 1.0) -> TimeScales:
    """A pair of poles with an amplitude in step amplitudes."""
    pole, period = complex(-DECAY, OMEGA), 2 * math.pi / OMEGA
    return TimeScales(
        poles=np.array([pole, pole.conjugate()]),
        amplitudes=np.full(2, amplitude / 2),
        slowest=1 / DECAY,
        ringing=(Ringing(1 / period, period, 1 / DECAY, amplitude),),
        growth_time=math.inf,
        stop=0.0,
        max_step=0.0,
    )


def small(**analysis: Any) -> Scene:
    """Three channels that ring at 166 kHz."""
    board = {
        "capacitance": 1e-11,
        "resistance": 14.4e6,
        "gain": 2.3e6,
        "unit_conductance": 1.16e-6,
        "stray_capacitance": 2.05e-12,
        "opamp": {
            "base": "ideal",
            "dc_gain": 1e5,
            "gbw": 0.9e6,
            "second_pole": 2.7e6,
            "output_resistance": 75.0,
        },
    }
    return make_scene({"channels": 3, "span": 2.0}, design=board, analysis=analysis)


@pytest.mark.parametrize("wanted", [1e-2, 1e-4])
def test_the_step_is_that_of_the_trapezoidal_rule_on_the_mode(wanted: float) -> None:
    """The rule itself, carried out on z' = p z at the step found, errs by what was asked for."""
    h = step_for_error(one_mode(), wanted, 5e-3)
    p = complex(-DECAY, OMEGA)
    k = np.arange(int(5e-3 / h))
    growth = (1 + p * h / 2) / (1 - p * h / 2)
    error = np.abs(growth**k - np.exp(p * h * k)).max()
    assert error == pytest.approx(wanted, rel=0.02)


def test_a_record_that_ends_early_has_less_error_to_pile_up() -> None:
    early, late = (step_for_error(one_mode(), 1e-3, stop) for stop in (1e-4, 5e-3))
    assert early / late == pytest.approx(math.sqrt(math.exp(-1) / (0.1 * math.exp(-0.1))), rel=1e-6)
    assert step_for_error(one_mode(), 0.9, 5e-3) <= 2 * math.pi / OMEGA / FEWEST_PER_PERIOD


def test_the_state_space_record_is_not_made_finer_by_an_error() -> None:
    scene = make_scene(analysis={"error": 1e-8})
    assert plan_transient(scene, one_mode(), "statespace") == plan_transient(
        make_scene(), one_mode(), "statespace"
    )


def test_error_and_points_exclude_each_other() -> None:
    with pytest.raises(InputError, match=r"'error' excludes 'points_per_period'"):
        make_scene(analysis={"error": 1e-4, "points_per_period": 125})
    with pytest.raises(InputError, match="error"):
        make_scene(analysis={"error": 1.5})


def test_auto_takes_the_cheapest_engine_unless_both_are_to_be_compared(ngspice: str) -> None:
    assert choose_engine(small()) == "ngspice"
    assert choose_engine(small(error=1e-4)) == "statespace"
    assert choose_engine(small(error=1e-4, engine="ngspice")) == "ngspice"
    compared = make_scene(analysis={"error": 1e-4}, checks={"engines_agree": {"tolerance": 1e-3}})
    assert choose_engine(compared) == "ngspice"


@pytest.mark.parametrize("wanted", [1e-2, 1e-3])
def test_ngspice_reaches_the_error_and_knows_it(ngspice: str, wanted: float) -> None:
    verdict = verify(small(error=wanted, engine="ngspice"))
    found = verdict.accuracy
    assert found is not None
    assert found.achieved is not None
    assert found.tries == 1
    assert found.reached
    assert found.method == "trapezoidal"
    wave = verdict.waveforms
    truth = exact_solution(verdict.circuit).at(np.asarray(wave.time))
    signs = np.array([output.sign for output in verdict.circuit.outputs])
    error = np.abs(outputs(verdict.circuit, wave) - signs * truth).max()
    # Richardson's estimate against the exact solution; the step is not wasted either
    assert found.achieved == pytest.approx(error / verdict.measurements.amplitude, rel=0.25)
    assert error / verdict.measurements.amplitude <= wanted


def test_a_step_that_misses_is_refined_once(ngspice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the estimate made four times too coarse, the second try reaches the error."""
    honest = transient_plan.step_for_error
    monkeypatch.setattr(transient_plan, "step_for_error", lambda *args: 4.0 * honest(*args))
    verdict = verify(small(error=1e-4, engine="ngspice"))
    found = verdict.accuracy
    assert found is not None
    assert found.tries == 2
    assert found.reached
    assert found.seconds > verdict.waveforms.cost.seconds
    assert verdict.scene.analysis.points_per_period is None
    document = json.loads(json.dumps(verdict_document(verdict)["accuracy"]))
    assert {"wanted", "achieved", "seconds", "points"} <= document.keys()
    assert document["wanted"] == 1e-4


def test_the_state_space_says_what_it_reached() -> None:
    linear = verify(small(error=1e-6, engine="statespace")).accuracy
    assert linear is not None
    assert linear.method == "exact"
    assert linear.achieved is not None
    assert linear.achieved < 1e-9
    scene = load_scene(SCENES / "paper-exponential.toml")
    analysis = {"error": 1e-4, "stop": 1e-4, "engine": "statespace"}
    scene = scene.model_copy(update={"analysis": scene.analysis.model_copy(update=analysis)})
    curved = verify(scene).accuracy
    assert curved is not None
    assert curved.reached
    assert curved.method == "implicit, adaptive"


def test_tolerances_stay_where_an_engine_can_follow() -> None:
    assert state_space_tolerance(1e-4) == pytest.approx(5e-6)
    assert state_space_tolerance(1e-15) == 1e-10
    assert state_space_tolerance(0.5) == 1e-3


TRIED = Accuracy(1e-4, 4e-4, 2.0, 1000, 100.0, "ngspice-46", "trapezoidal", "")


def test_only_a_known_miss_of_a_stepping_engine_is_tried_again() -> None:
    scene = small(error=1e-4, engine="ngspice")
    design = design_board(scene, Clock(lambda stage: None))
    again = finer(design, TRIED)
    assert again is not None
    # second order, aimed at 80 % of the error: 100 sqrt(4 / 0.8)
    period = design.scales.max_step_for(1.0)
    assert period / again.transient.max_step == pytest.approx(223.607, rel=1e-5)
    assert again.transient.stop == design.transient.stop
    assert again.scene is design.scene
    assert finer(design, replace(TRIED, achieved=1e-5)) is None
    assert finer(design, replace(TRIED, achieved=None)) is None
    assert finer(design, replace(TRIED, engine="statespace")) is None
    assert finer(design, None) is None
    both = both_tries(TRIED, replace(TRIED, seconds=3.0))
    assert both is not None
    assert (both.seconds, both.tries) == (5.0, 2)


def test_a_scene_without_an_error_has_no_accuracy() -> None:
    assert verify(small(engine="statespace")).accuracy is None
    assert verdict_document(verify(small(engine="statespace")))["accuracy"] is None
