"""Worst cases: against every corner, against random samples, and a user's own."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from taction.netlist_gen.scene.check_keys import Tolerances
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.tolerance_view import corner_view
from taction.verification.studies.tolerance.corners import (
    Corner,
    named_corners,
    worst_of,
)
from taction.verification.studies.tolerance.montecarlo import SampleCollection, run_samples
from taction.verification.studies.tolerance.varied_board import evaluate, prepare
from taction.verification.verdict.input_spread import tolerance_slopes
from tests.support.running import taction as command
from tests.support.studying import DAMPED, QUIET, one_thread, small_scene

WORN = {"resistor": 0.05, "capacitor": 0.1, "distribution": "uniform"}
FEW = QUIET | {"capacitor": 0.1, "temperature": 30.0}
CHECKS = {"steady_state": {"tolerance": 0.05}, "settling_time": {"band": 0.3}}
ROUNDING = 1e-12  # of an excursion that is 0
QUANTITIES = ("settling_time", "overshoot", "undershoot", "steady_state", "growth_rate")


def worst(found: tuple[Corner, ...], quantity: str) -> float:
    corner = next(corner for corner in found if corner.quantity == quantity)
    value = corner.result.value(quantity)
    assert isinstance(value, float)
    return value


def taction(*arguments: str) -> Result:
    return command("corners", *arguments)


def test_no_corner_is_worse_than_the_worst() -> None:
    scene = small_scene(tolerances=FEW, checks=CHECKS)
    study = prepare(scene)
    assert [p.name for p in study.varied] == ["Cc_1", "Cc_2", "temperature"]
    with one_thread() as workers:
        found = worst_of(prepare(scene, full_margin=True), workers).corners
    every = [
        evaluate(study, 0, np.array(ends)) for ends in itertools.product((-1.0, 1.0), repeat=3)
    ]
    for quantity in QUANTITIES:
        most = max(sample.value(quantity) for sample in every)
        assert worst(found, quantity) == pytest.approx(most, rel=1e-9)


def test_the_worst_corner_is_worse_than_any_random_sample() -> None:
    scene = small_scene(tolerances=WORN, checks=CHECKS)
    study, tally = prepare(scene), SampleCollection(60)
    with one_thread() as workers:
        found = worst_of(prepare(scene, full_margin=True), workers).corners
        list(run_samples(study, range(60), 1, workers, tally))
    for quantity in QUANTITIES:
        values = [sample.value(quantity) for sample in tally.samples]
        worst_drawn = max(value for value in values if value is not None)
        assert worst(found, quantity) >= worst_drawn - ROUNDING
    # Most resistors count for the steady state: random samples stay away from the corner.
    steady = [sample.value("steady_state") or 0.0 for sample in tally.samples]
    assert worst(found, "steady_state") > 1.25 * max(steady)


def test_the_nominal_board_comes_first_and_corners_say_what_moves_them() -> None:
    with one_thread() as workers:
        found = worst_of(
            prepare(small_scene(tolerances=FEW, checks=CHECKS), full_margin=True), workers
        ).corners
    assert [corner.name for corner in found] == ["nominal", *(f"worst {q}" for q in QUANTITIES)]
    assert found[0].deviations == {}
    slowest = next(corner for corner in found if corner.quantity == "growth_rate")
    assert set(slowest.deviations.values()) <= {-1.0, 1.0}
    assert {"+Cc_1", "+Cc_2"} <= set(slowest.largest)


def test_a_margin_that_is_checked_has_its_corner() -> None:
    real = {"base": "ideal", "dc_gain": 1e5, "gbw": "1MHz", "second_pole": "3MHz"}
    design: dict[str, Any] = {
        "capacitance": "10pF",
        "gain": "300kohm",
        "stray_capacitance": "5pF",
        "opamp": real,
    }
    design |= {"unit_conductance": "10uS", "lambda": 0.1}
    tolerances = QUIET | {"stray": 0.5, "opamp_gbw": 0.3}
    checks = CHECKS | {"stability": {"margin": 1.5}}
    scene = small_scene(design=design, tolerances=tolerances, checks=checks)
    with one_thread() as workers:
        found = worst_of(prepare(scene, full_margin=True), workers).corners
    nominal, least = found[0].result.value("margin"), worst(found, "margin")
    assert least < 0.9 * nominal
    tight = next(corner for corner in found if corner.quantity == "margin")
    assert all(v == 1.0 for name, v in tight.deviations.items() if name.startswith("Cstray_c"))


def test_a_corner_of_one_s_own_by_kind_and_by_name() -> None:
    study = prepare(small_scene(tolerances=WORN, checks=CHECKS))
    mine = {"resistor": 1.0, "Rf_1_2": -0.5, "capacitor": -1.0}
    (corner,) = named_corners(study, [("mine", mine)])
    assert corner.deviations["Rf_1_2"] == -0.5
    assert corner.deviations["Rf_1_1"] == corner.deviations["Rb_1_2"] == 1.0
    assert corner.deviations["Cc_2"] == -1.0
    assert "v_1.dc_gain" not in corner.deviations
    z = np.array([corner.deviations.get(p.name, 0.0) for p in study.varied])
    assert corner.result == evaluate(study, 0, z)


def test_the_directions_are_those_of_every_corner_of_all_resistors_of_two_kinds() -> None:
    """Two resistors R and the DC gains vary: no corner of a channel is worse than its direction."""
    tolerances = QUIET | {"resistor": 0.02, "opamp_gain": 0.5}
    opamp = {"base": "ideal", "dc_gain": 300}
    study = prepare(small_scene(design=DAMPED | {"opamp": opamp}, tolerances=tolerances))
    with one_thread() as workers:
        found = worst_of(study, workers).directions
    assert [(d.channel, d.sign) for d in found] != sorted((d.channel, d.sign) for d in found)
    assert {(d.channel, d.sign) for d in found} == set(itertools.product((1, 2), (1, -1)))
    assert {name.rpartition(".")[2] for name in found[0].deviations} >= {"dc_gain", "Rr_1"}
    random = np.random.default_rng(3)
    for direction in found:
        (made,) = named_corners(study, [("", direction.deviations)])
        corner = made.result.errors
        assert corner[direction.channel - 1] == pytest.approx(direction.solved, rel=1e-6)
        assert direction.predicted == pytest.approx(direction.solved, rel=0.15)
        for _ in range(20):
            z = random.choice([-1.0, 1.0], len(study.varied))
            error = evaluate(study, 0, z).errors[direction.channel - 1]
            assert direction.sign * error <= direction.sign * direction.solved + 1e-12


def test_slopes_are_those_of_the_solved_boards() -> None:
    """Every kind of component, against central differences of the equilibrium."""
    tolerances = {"resistor": 0.01, "opamp_gain": 0.2, "temperature": 20.0}
    scene = small_scene(design=DAMPED | {"opamp": {"base": "ideal", "dc_gain": 300}})
    scene = scene.model_copy(update={"tolerances": Tolerances(**tolerances)})
    study = prepare(scene)
    names = [part.name for part in study.varied]
    slopes = tolerance_slopes(
        RestSensitivity.of(LinearBoard(study.nominal)),
        study.varied,
        lambda name, z: study.at(np.array([z * (name == each) for each in names])),
    )

    def rest(z: Floats) -> Floats:
        board = LinearBoard(study.at(z))
        return np.array([o.sign * board.equilibrium[o.node] for o in study.nominal.outputs])

    for place, unit in enumerate(0.01 * np.eye(len(study.varied))):
        expected = (rest(unit) - rest(-unit)) / 0.02
        assert slopes[place] == pytest.approx(expected, rel=1e-5, abs=1e-9)


def test_the_worst_corner_at_rest_is_the_first_direction() -> None:
    scene = small_scene(tolerances=WORN, checks=CHECKS)
    with one_thread() as workers:
        study = worst_of(prepare(scene, full_margin=True), workers)
    first = study.directions[0]
    assert worst(study.corners, "steady_state") == pytest.approx(abs(first.solved), rel=1e-6)
    assert first.predicted == pytest.approx(first.solved, rel=0.3)  # the parts vary by 5 %
    printed = page_text(corner_view(study))
    assert "first order" in printed
    assert all(name in printed for name in first.largest)
