"""What to buy better: the prediction against samples that are drawn again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest, norm

from taction.netlist_gen.board.variation import parameters, with_input_errors_at
from taction.netlist_gen.scene.checks import Tolerances
from taction.netlist_gen.scene.loading import load_scene
from taction.system.array_types import Floats
from taction.system.errors import InputError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.report.views.montecarlo import view
from taction.verification.studies.tolerance.drawing import SampleCollection, run_samples
from taction.verification.studies.tolerance.remedy import (
    YieldForecast,
    find_remedy,
    improved,
    verified_remedy,
)
from taction.verification.studies.tolerance.samples import BoardSample, evaluate
from taction.verification.studies.tolerance.steady_directions import rest_slopes
from taction.verification.studies.tolerance.varied_board import VariedBoard, prepare
from taction.verification.studies.tolerance.yield_report import (
    Remedy,
    draw,
    interval,
    summarise_samples,
)
from taction.verification.verdict.error_budget import outputs_at_rest
from tests.support.running import taction as command
from tests.support.studying import QUIET, one_thread, small_scene
from tests.support.sweeping import make_sample

SEED, COUNT = 7, 60
FINE = QUIET | {"resistor": 1e-4}


def study(tolerances: dict[str, Any], limit: float, **checks: Any) -> VariedBoard:
    checks = {"steady_state": {"tolerance": limit}, "settling_time": {"band": 0.2}} | checks
    return prepare(small_scene(tolerances=tolerances, checks=checks))


def drawn(board: VariedBoard, count: int = COUNT) -> list[BoardSample]:
    tally = SampleCollection(count)
    with one_thread() as workers:
        list(run_samples(board, range(count), SEED, workers, tally))
    return tally.samples


def limit_of_one_sigma(tolerances: dict[str, Any], part: str) -> float:
    """The error at rest, in steps, for one standard deviation of a part."""
    board = study(tolerances, 0.5)
    place = [parameter.name for parameter in board.varied].index(part)
    return float(np.abs(rest_slopes(board)[place]).max() / board.step_amplitude / 3.0)


def test_the_one_part_that_matters_is_found_and_drawn_again() -> None:
    tolerances = FINE | {"parts": {"Rr_1": 0.01}}
    board = study(tolerances, limit_of_one_sigma(tolerances, "Rr_1"))
    samples = drawn(board)
    passed = sum(sample.outcome == "pass" for sample in samples)
    assert passed / COUNT == pytest.approx(norm.cdf(1) - norm.cdf(-1), abs=0.15)
    found = verified_remedy(board, samples, SEED, one_thread)
    assert found.parts == {"Rr_1": 1e-3}
    assert found.kinds == {}
    assert found.what == "Rr_1 to 0.1 %"
    assert (found.predicted, found.passed, found.samples) == (1.0, COUNT, COUNT)
    expected = binomtest(COUNT, COUNT).proportion_ci(0.95, method="exact")
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_the_prediction_names_the_samples_that_pass() -> None:
    tolerances = QUIET | {"resistor": 0.01}
    board = study(tolerances, 0.003)
    samples = drawn(board, 40)
    remedy = Remedy({"Rr_1": 1e-3, "Rr_2": 1e-3}, {}, 0.99, 0.0)
    places = [k for k, p in enumerate(board.varied) if p.name in remedy.parts]
    forecast = YieldForecast.of(board, samples, SEED)
    assert forecast.passes.tolist() == [sample.outcome == "pass" for sample in samples]
    predicted = forecast.better(dict.fromkeys(places, 1e-3)).passes
    again = np.array([sample.outcome == "pass" for sample in drawn(improved(board, remedy), 40)])
    assert 0.1 < again.mean() < 0.9
    assert np.count_nonzero(predicted != again) <= 1
    assert np.count_nonzero(forecast.passes != again) > 1


def test_where_every_resistor_matters_every_resistor_has_to_be_better() -> None:
    board = study(QUIET | {"resistor": 0.01}, 2e-3)
    found = find_remedy(board, drawn(board), SEED, 0.99)
    assert (found.parts, found.kinds) == ({}, {"resistor": 1e-3})
    assert found.what == "every resistor to 0.1 %"
    better = improved(board, found)
    assert {p.tolerance for p in better.varied} == {1e-3}
    assert [p.name for p in better.varied] == [p.name for p in board.varied]


def test_failures_that_nothing_on_sale_mends() -> None:
    """The gain of the op-amps makes the error."""
    tolerances = QUIET | {"opamp_gain": 0.9}
    design = {"capacitance": "100pF", "gain": "100kohm", "stray_capacitance": 0}
    design |= {"opamp": {"base": "ideal", "dc_gain": 500}}
    nominal = prepare(small_scene(design=design, tolerances=tolerances))
    error = evaluate(nominal, 0, np.zeros(len(nominal.varied))).value("steady_state")
    checks = {"steady_state": {"tolerance": 1.05 * error}, "settling_time": {"band": 0.2}}
    board = prepare(small_scene(design=design, tolerances=tolerances, checks=checks))
    samples = drawn(board)
    assert 0 < sum(sample.outcome == "pass" for sample in samples) < COUNT
    found = verified_remedy(board, samples, SEED, one_thread)
    assert (found.what, found.samples) == ("", 0)


def test_a_slow_board_is_mended_by_its_capacitor() -> None:
    """The settling time follows C of the channels; it moves by its regression on the samples."""
    tolerances = QUIET | {"capacitor": 0.05}
    nominal = prepare(small_scene(tolerances=tolerances))
    time = evaluate(nominal, 0, np.zeros(len(nominal.varied))).value("settling_time")
    checks = {"settling_time": {"band": 0.01, "max": 1.01 * time}}
    board = study(tolerances, 0.5, **checks)
    samples = drawn(board)
    assert 0.3 < sum(sample.outcome == "pass" for sample in samples) / COUNT < 0.97
    found = verified_remedy(board, samples, SEED, one_thread)
    assert set(found.parts) <= {"Cc_1", "Cc_2"}
    assert set(found.parts.values()) == {0.01}
    assert found.passed >= 0.99 * found.samples


def test_no_remedy_without_need_or_without_samples() -> None:
    board = study(FINE, 0.1)
    samples = drawn(board, 31)
    assert find_remedy(board, samples, SEED, 0.99) is None
    assert find_remedy(board, samples[:5], SEED, 0.99) is None


@pytest.mark.parametrize(
    ("remedy", "text"),
    [
        (Remedy({"Rf_4_4": 1e-3, "Ra_4_in": 1e-3}, {}, 0.99, 0.994, 300, 298, 0.976, 0.999),
         "Rf_4_4 and Ra_4_in to 0.1 %: yield 99.33 %, predicted 99.4 %; 298 of the first 300"),
        (Remedy({}, {"resistor": 1e-4}, 0.99, 0.9),
         "nothing that is sold better gives 99 %; best: every resistor to 0.01 %: yield 90 %"),
        (Remedy({"A": 0.01, "B": 0.01, "C": 0.01}, {}, 0.99, 1.0), "A, B and C to 1 %: yield 100"),
        (Remedy({}, {}, 0.99, 0.5), "no resistor or capacitor that is sold better"),
    ],
)  # fmt: skip
def test_the_report_says_it_behind_the_yield(remedy: Remedy, text: str) -> None:
    from dataclasses import replace

    board = study(FINE, 0.1)
    report = summarise_samples(board, [make_sample(0)], SEED)
    words = view(replace(report, remedy=remedy)).summary
    assert f"1 of 1 boards pass. {text[0].upper()}{text[1:]}" in words


def test_single_parts_have_tolerances_of_their_own() -> None:
    board = study(QUIET | {"parts": {"Rf_1_2": 0.02, "Cc_1": 0.03}}, 0.1)
    assert [(p.name, p.kind, p.tolerance) for p in board.varied] == [
        ("Rf_1_2", "resistor", 0.02),
        ("Cc_1", "capacitor", 0.03),
    ]
    unknown = Tolerances(parts={"Rf_4_44": 0.01})
    with pytest.raises(InputError, match=r"tolerances.parts.Rf_4_44: .* nearest name is 'Rf_"):
        parameters(board.nominal, unknown)


def fresh(tmp_path: Any) -> VariedBoard:
    path = tmp_path / "fresh.toml"
    assert command("new", str(path)).exit_code == 0
    return prepare(load_scene(path).with_engine("statespace"))


def test_a_fresh_scene_yields_over_90_percent(tmp_path: Any) -> None:
    """600 boards of the steady state, which decides alone; some of them are verified in full."""
    board = fresh(tmp_path)
    z = np.array([draw(board.scene.tolerances, board.varied, 1, k) for k in range(600)])
    middle = with_input_errors_at(board.nominal, {})  # the errors at their means
    nominal = outputs_at_rest(LinearBoard(middle)) - board.ideal.target
    errors: Floats = np.abs(nominal + z @ rest_slopes(board)) / board.step_amplitude
    limit = board.scene.checks.steady_state.tolerance
    passed = int((errors.max(axis=1) <= limit).sum())
    assert interval(passed, 600)[0] > 0.9
    assert board.scene.checks.settling_time.band >= 2 * limit
    for number in range(4):
        sample = evaluate(board, number, z[number])
        assert np.abs(sample.errors).max() == pytest.approx(errors[number].max(), rel=0.15)
        assert sample.outcome == ("pass" if errors[number].max() <= limit else "fail")
