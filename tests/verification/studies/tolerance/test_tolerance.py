"""Yields and worst cases: intervals in closed form, draws that nothing disturbs, kept samples."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from taction.netlist_gen.board.variation import DYNAMIC, draw
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.report.views.sweep_view import columns_of
from taction.verification.studies.running import versions
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import HERE, WorkerDiedError, Workers, local
from taction.verification.studies.tolerance import montecarlo
from taction.verification.studies.tolerance.corners import (
    PROBE,
    Corner,
    corners,
    steady_slopes,
    worst_of,
)
from taction.verification.studies.tolerance.montecarlo import (
    BoardSample,
    VariedBoard,
    interval,
    prepare,
    quantities,
    run_samples,
    sample_keys,
    summarise_samples,
)
from taction.verification.verdict.input_spread import tolerance_deviations
from tests.support.entries import make_sample
from tests.support.running import taction as command
from tests.support.studying import (
    DAMPED,
    QUIET,
    Failing,
    scene_file,
    small_scene,
    stored_samples,
)

STUDY = prepare(small_scene())
SAMPLES = [make_sample(0, settling_time=1e-6), make_sample(2, "fail", ("stability",), margin=1.5)]
WORN = {"resistor": 0.05, "capacitor": 0.1, "distribution": "uniform"}
FEW = QUIET | {"capacitor": 0.1, "temperature": 30.0}
CHECKS = {"steady_state": {"tolerance": 0.05}, "settling_time": {"band": 0.3}}
QUANTITIES = ("settling_time", "overshoot", "undershoot", "steady_state", "growth_rate")


def found(store: Store, study: VariedBoard = STUDY, seed: int = 1) -> list[BoardSample | None]:
    return [store.record_of(key, BoardSample) for key in map(sample_keys(study, seed), range(3))]


LOOSER = {"checks": {"steady_state": {"tolerance": 0.1}}}


@pytest.mark.parametrize(("seed", "tables", "changed"), [
    (2, {}, {}), (1, LOOSER, {}), (1, {"name": "another"}, {}), (1, {}, {"own_code": b"other"}),
    (1, {}, {"simulator_name": "other"}),
])  # fmt: skip
def test_samples_of_another_scene_or_program_are_new(
    seed: int, tables: Any, changed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Store(":memory:") as store:
        for sample in SAMPLES:
            store.put(sample_keys(STUDY, 1)(sample.number), sample)
        assert found(store) == [SAMPLES[0], None, SAMPLES[1]]
        for name, value in changed.items():
            monkeypatch.setattr(versions, name, lambda *engine, value=value: value)
        assert found(store, prepare(small_scene(**tables)), seed) == [None] * 3


def test_only_what_is_missing_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = str(tmp_path / "a")
    with Store(path) as store:
        first = list(run_samples(STUDY, 4, 1, HERE, store))
        assert store.count() == 4
        again = list(run_samples(STUDY, 6, 1, HERE, store))
        assert store.count() == 6
        # What is missing, which is nothing, takes the place of its samples.
        monkeypatch.setattr(montecarlo, "evaluate_all", lambda board, missing, _: [*missing])
        assert list(run_samples(STUDY, 6, 1, HERE, store)) == again
    monkeypatch.undo()
    assert again == list(run_samples(STUDY, 6, 1, HERE))
    assert again[:4] == first
    assert [row["number"] for row in stored_samples(Path(path))] == list(range(6))


REAL = DAMPED | {"opamp": {"base": "ideal", "gbw": "50MHz", "voltage_noise": "10nV/rtHz"}}
LIMIT = {"steady_state": {"tolerance": 0.5}, "settling_time": {"band": 0.5}}


def scene(volts: float | None) -> Scene:
    noise = {} if volts is None else {"noise": {"max": volts}}
    tolerances = QUIET | {"resistor": 0.05, "capacitor": 0.2}
    return small_scene(design=REAL, checks=LIMIT | noise, tolerances=tolerances)


def test_the_spread_of_the_noise_has_its_limit() -> None:
    nominal = prepare(scene(1e-3))
    rms, _ = output_noise(LinearBoard(nominal.nominal))
    study, middle = prepare(scene(float(rms.max()))), pytest.approx(rms.max(), rel=1e-9)
    assert nominal.measured(0, np.zeros(len(nominal.varied))).value("noise") == middle
    tolerances = study.scene.tolerances
    samples = [study.measured(k, draw(tolerances, study.varied, 1, k)) for k in range(40)]
    assert 5 < sum(sample.record.failed == ("noise",) for sample in samples) < 35
    report = summarise_samples(study, samples, 1)
    spread = next(each for each in report.quantities if each.name == "noise")
    assert (spread.unit, spread.at_most, spread.missing) == ("V", middle, 0)
    assert spread.low < rms.max() < spread.high
    assert "noise" not in {quantity.name for quantity in quantities(scene(None))}
    assert columns_of(scene(1e-3))[-1] == "noise"  # of a sweep's table
    assert "noise" not in columns_of(scene(None))


def worst(found: tuple[Corner, ...], quantity: str) -> float:
    corner = next(corner for corner in found if corner.quantity == quantity)
    value = corner.result.value(quantity)
    assert isinstance(value, float)
    return value


def test_no_corner_is_worse_than_the_worst_and_each_says_what_moves_it() -> None:
    scene = small_scene(tolerances=FEW, checks=CHECKS)
    study = prepare(scene)
    assert [p.name for p in study.varied] == ["Cc_1", "Cc_2", "temperature"]
    found = worst_of(prepare(scene, full_margin=True), HERE).corners
    every = [study.measured(0, np.array(ends)) for ends in itertools.product((-1.0, 1.0), repeat=3)]
    for quantity in QUANTITIES:
        most = max(sample.value(quantity) for sample in every)
        assert worst(found, quantity) == pytest.approx(most, rel=1e-9)
    assert [corner.name for corner in found] == ["nominal", *(f"worst {q}" for q in QUANTITIES)]
    assert found[0].deviations == {}
    slowest = next(corner for corner in found if corner.quantity == "growth_rate")
    assert set(slowest.deviations.values()) <= {-1.0, 1.0}
    assert {"+Cc_1", "+Cc_2"} <= set(slowest.largest)


class Bent(VariedBoard):
    """A board whose overshoot is not worst where its nominal slopes lead to."""

    def measured(self, number: int, z: Floats) -> BoardSample:
        return make_sample(number, overshoot=2.0 + z[0] + 2.0 * z[1] - 1.5 * z[0] * z[1])


def test_where_the_first_order_misses_the_slopes_at_the_corner_lead_on() -> None:
    study = prepare(small_scene(tolerances=FEW, checks=CHECKS))
    found = worst_of(Bent(**vars(study) | {"step_amplitude": math.nan}), HERE).corners
    assert worst(found, "overshoot") == 4.5


def test_a_margin_that_is_checked_has_its_corner() -> None:
    real = {"base": "ideal", "dc_gain": 1e5, "gbw": "1MHz", "second_pole": "3MHz"}
    design = {"capacitance": "10pF", "gain": "300kohm", "stray_capacitance": "5pF", "opamp": real}
    design |= {"unit_conductance": "10uS", "lambda": 0.1}
    tolerances = QUIET | {"stray": 0.5, "opamp_gbw": 0.3}
    checks = CHECKS | {"stability": {"margin": 1.5}}
    scene = small_scene(design=design, tolerances=tolerances, checks=checks)
    found = worst_of(prepare(scene, full_margin=True), HERE).corners
    nominal, least = found[0].result.value("margin"), worst(found, "margin")
    assert least < 0.9 * nominal
    tight = next(corner for corner in found if corner.quantity == "margin")
    assert all(v == 1.0 for name, v in tight.deviations.items() if name.startswith("Cstray_c"))

    text = str(montecarlo.montecarlo(scene, samples=3, jobs=1).page())
    assert nominal > 1.6
    assert "Margin: 1.5 means 1.5 or more, where the search ends." in text


def test_a_corner_of_one_s_own_by_kind_and_by_name() -> None:
    scene = small_scene(tolerances=WORN, checks=CHECKS)
    study = prepare(scene, full_margin=True)
    mine = {"resistor": 1.0, "Rf_1_2": -0.5, "capacitor": -1.0}
    (corner,) = corners(scene, corner=[mine]).corners
    assert corner.deviations["Rf_1_2"] == -0.5
    assert corner.deviations["Rf_1_1"] == corner.deviations["Rb_1_2"] == 1.0
    assert corner.deviations["Cc_2"] == -1.0
    assert "v_1.dc_gain" not in corner.deviations
    z = np.array([corner.deviations.get(p.name, 0.0) for p in study.varied])
    assert corner.result == study.measured(0, z)


def test_slopes_at_rest_are_those_of_the_equilibria_where_a_board_has_no_verdict() -> None:
    study = prepare(small_scene(tolerances=WORN, checks=CHECKS))
    count = len(study.varied)
    centre = study.measured(0, np.zeros(count))
    moved = [study.measured(0, z) for z in PROBE * np.eye(count)]
    assert centre.errors
    lost = steady_slopes(study, replace(centre, errors=()), moved)
    for found, expected in zip(lost, steady_slopes(study, centre, moved), strict=True):
        assert found == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())
    ends = [[study.measured(0, s * z).errors for s in (1.0, -1.0)] for z in 0.1 * np.eye(count)]
    columns = np.array([np.subtract(*pair) / 0.2 for pair in ends]).T  # central differences
    for found in lost:
        assert min(np.abs(s * each - found).max() for each in columns for s in (1, -1)) < 1e-3


def test_slopes_are_those_of_the_solved_boards() -> None:
    """Every kind of component, against central differences of the equilibrium."""
    tolerances = {"resistor": 0.01, "opamp_gain": 0.2, "temperature": 20.0}
    scene = small_scene(design=DAMPED | {"opamp": {"base": "ideal", "dc_gain": 300}})
    scene = scene.model_copy(update={"tolerances": Tolerances(**tolerances)})
    study = prepare(scene)
    names = [part.name for part in study.varied]
    found = tolerance_deviations(
        RestSensitivity.of(LinearBoard(study.nominal)),
        [part for part in study.varied if part.kind not in DYNAMIC],
        lambda shares: study.at(np.array([shares.get(name, 0.0) for name in names])),
        1.0,
    )
    rows = {each.part: each.row for each in found}

    def rest(z: Floats) -> Floats:
        board = LinearBoard(study.at(z))
        return np.array([o.sign * board.equilibrium[o.node] for o in study.nominal.outputs])

    assert {part.kind for part in study.varied} > {"resistor", "opamp_gain", "temperature"}
    for name, unit in zip(names, 0.01 * np.eye(len(names)), strict=True):
        expected = (rest(unit) - rest(-unit)) / 0.02
        assert rows.get(name, np.zeros(2)) == pytest.approx(expected, rel=1e-5, abs=1e-9)


LOOSE = {"resistor": 0.05, "capacitor": 0.1}


def study(**tables: Any) -> VariedBoard:
    checks = {"steady_state": {"tolerance": 0.03}, "settling_time": {"band": 0.2, "max": "1s"}}
    tables = {"tolerances": LOOSE, "checks": checks} | tables
    return prepare(small_scene(**tables))


def drawn(asked: VariedBoard, count: int, workers: Workers = HERE) -> list[BoardSample]:
    return sorted(run_samples(asked, count, 5, workers), key=lambda sample: sample.number)


@pytest.mark.parametrize(("passed", "samples"), [(0, 10), (10, 10), (3, 10), (970, 1000), (1, 2)])
def test_the_interval_is_clopper_and_pearson_s(passed: int, samples: int) -> None:
    assert interval(0, 0) == (0.0, 1.0)
    low, high = interval(passed, samples)
    expected = binomtest(passed, samples).proportion_ci(0.95, method="exact")
    assert (low, high) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_a_sample_is_the_same_alone_in_a_batch_and_in_any_order() -> None:
    asked = study()
    batch = drawn(asked, 6)
    assert [sample.number for sample in batch] == list(range(6))
    z = draw(asked.scene.tolerances, asked.varied, 5, 4)
    assert asked.measured(4, z) == batch[4]
    assert len({sample.value("steady_state") for sample in batch}) == 6
    with local(2) as workers:
        assert drawn(asked, 6, workers) == batch


def test_the_yield_counts_what_the_checks_say() -> None:
    asked = study()
    samples = drawn(asked, 40)
    found = summarise_samples(asked, samples, 5)
    values = [s.value("steady_state") for s in samples]
    errors = sorted(value for value in values if value is not None)
    within = sum(value <= 0.03 for value in errors)
    assert 0 < within < 40
    failures = {"steady_state": 40 - within}
    assert (found.samples, found.passed, found.failures) == (40, within, failures)
    assert (found.low, found.high) == interval(within, 40)
    spread = next(each for each in found.quantities if each.name == "steady_state")
    low, median, high = (errors[k] for k in (1, 19, 37))
    assert (spread.at_most, spread.low, spread.median, spread.high) == (0.03, low, median, high)
    z = np.array([draw(asked.tolerances, asked.varied, 5, n) for n in range(40)])
    signed = [sample.errors[(spread.channel or 0) - 1] for sample in samples]
    expected = np.corrcoef([*z.T, signed])[-1, :-1]
    assert 0 < len(spread.parts) == (np.abs(expected) > 4.0 / math.sqrt(40.0)).sum()
    places = {part.name: n for n, part in enumerate(asked.varied)}
    for name, size in spread.parts.items():
        assert size == pytest.approx(expected[places[name]], rel=1e-9)


def test_samples_without_verdict_count_as_not_passed() -> None:
    asked = study()
    lost = make_sample(1, "error", failure="Killed", reason="lost")
    never = make_sample(2, "fail", ("settling_time",), settling_time=None)
    found = summarise_samples(asked, [make_sample(0, settling_time=1e-6), lost, never], 1)
    assert (found.passed, found.without_verdict) == (1, 1)
    assert found.fraction == pytest.approx(1 / 3)
    assert found.reasons == {"lost": 1}
    settling = found.quantities[0]
    # Of the two with a verdict one never settles; the lost one is not among them.
    assert (settling.low, settling.high, settling.missing) == (1e-6, math.inf, 1)


def test_a_lost_worker_costs_its_sample_only() -> None:
    workers = Workers(Failing(WorkerDiedError("gone"), every=3), 2)
    samples = drawn(study(), 9, workers)
    assert len([s.number for s in samples if s.undecided]) == 3
    assert samples[0].lost == "its process was killed several times (out of memory?): gone"


def test_the_smallest_yield_decides_the_exit_status(tmp_path: Path) -> None:
    scene, file = scene_file(tmp_path), str(tmp_path / "s.sqlite")
    found = json.loads(
        command("montecarlo", scene, "-n", "12", "--jobs", "1", "-o", file, "--json").stdout
    )
    assert 0 < found["low"] < found["fraction"]
    for wanted, status in ((0.9 * found["low"], 0), (found["fraction"], 3)):
        again = command("montecarlo", scene, "-n", "12", "-o", file, "--min-yield", repr(wanted))
        assert again.exit_code == status
        assert again.stdout.rstrip().endswith("INCONCLUSIVE" if status else "PASS")
        assert "; wanted: at least " in again.stdout
    strict = tmp_path / "strict"
    strict.mkdir()
    hard = scene_file(strict, "[tolerances]\nresistor = 0.5\n")
    assert command("montecarlo", hard, "-n", "12", "--jobs", "1", "--min-yield", "1").exit_code == 1


def test_ngspice_takes_the_same_way(tmp_path: Path, ngspice: str) -> None:
    scene = scene_file(tmp_path)
    found = {}
    for engine in ("ngspice", "statespace"):
        file = tmp_path / f"{engine}.sqlite"
        arguments = ["-n", "3", "--jobs", "1", "--engine", engine, "-o", str(file)]
        assert command("montecarlo", scene, *arguments).exit_code == 0
        found[engine] = stored_samples(file)
    for one, other in zip(found["ngspice"], found["statespace"], strict=True):
        assert one["outcome"] == other["outcome"]
        assert one["settling_time"] == pytest.approx(other["settling_time"], rel=1e-3)
        assert one["steady_state_error"] == pytest.approx(other["steady_state_error"], abs=1e-5)
