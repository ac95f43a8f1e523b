"""Samples in the database, the noise of samples and points, and worst cases."""

from __future__ import annotations

import itertools
import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.variation import DYNAMIC, draw, vary
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.sweep_view import columns_of
from taction.verification.report.views.tolerance_view import corner_view
from taction.verification.studies.running.store import Store
from taction.verification.studies.tolerance import montecarlo
from taction.verification.studies.tolerance.corners import Corner, named_corners, worst_of
from taction.verification.studies.tolerance.montecarlo import (
    SampleCollection,
    run_samples,
    sample_keys,
    summarise_samples,
)
from taction.verification.studies.tolerance.varied_board import (
    BoardSample,
    VariedBoard,
    evaluate,
    prepare,
    quantities,
)
from taction.verification.verdict.input_spread import tolerance_deviations
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import verify
from tests.support.entries import make_sample
from tests.support.running import taction
from tests.support.studying import (
    DAMPED,
    QUIET,
    one_thread,
    scene_file,
    small_scene,
    stored_samples,
)

STUDY = prepare(small_scene())
SAMPLES = [make_sample(0, settling_time=1e-6), make_sample(2, "fail", ("stability",), margin=1.5)]
WORN = {"resistor": 0.05, "capacitor": 0.1, "distribution": "uniform"}
FEW = QUIET | {"capacitor": 0.1, "temperature": 30.0}
CHECKS = {"steady_state": {"tolerance": 0.05}, "settling_time": {"band": 0.3}}
ROUNDING = 1e-12  # of an excursion that is 0
QUANTITIES = ("settling_time", "overshoot", "undershoot", "steady_state", "growth_rate")


def filled(path: Path, study: VariedBoard = STUDY, seed: int = 1) -> str:
    with Store(str(path)) as store:
        for sample in SAMPLES:
            store.put(sample_keys(study, seed)(sample.number), sample)
    return str(path)


def found(path: str, study: VariedBoard = STUDY, seed: int = 1) -> list[BoardSample | None]:
    with Store(path) as store:
        return [
            store.record_of(key, BoardSample) for key in map(sample_keys(study, seed), range(3))
        ]


def test_what_was_kept_is_read_again(tmp_path: Path) -> None:
    assert found(filled(tmp_path / "a")) == [SAMPLES[0], None, SAMPLES[1]]


@pytest.mark.parametrize(
    ("seed", "tables"),
    [(2, {}), (1, {"checks": {"steady_state": {"tolerance": 0.1}}}), (1, {"name": "another"})],
)
def test_samples_of_another_seed_or_scene_are_not_found(
    tmp_path: Path, seed: int, tables: dict[str, Any]
) -> None:
    path = filled(tmp_path / "a")
    assert found(path, prepare(small_scene(**tables)), seed) == [None] * 3
    filled(Path(path), seed=7)
    assert found(path) == found(path, seed=7) == [SAMPLES[0], None, SAMPLES[1]]


@pytest.mark.parametrize(("name", "value"), [("own_code", b"other"), ("simulator_name", "other")])
def test_samples_of_another_taction_or_ngspice_are_not_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: bytes | str
) -> None:
    path = filled(tmp_path / "a")
    monkeypatch.setattr(montecarlo, name, lambda *engine: value)
    assert found(path) == [None] * 3


def test_only_what_is_missing_is_drawn_and_the_yield_is_the_same(tmp_path: Path) -> None:
    path, fresh, again = str(tmp_path / "a"), SampleCollection(6), SampleCollection(6)
    with Store(path) as store, one_thread() as workers:
        kept = store, sample_keys(STUDY, 1)
        first = list(run_samples(STUDY, range(4), 1, workers, SampleCollection(4), *kept))
        second = list(run_samples(STUDY, range(6), 1, workers, again, *kept))
        list(run_samples(STUDY, range(6), 1, workers, fresh))
        assert list(run_samples(STUDY, range(6), 1, workers, SampleCollection(6), *kept)) == []
    assert sorted(s.number for s in first) == [0, 1, 2, 3]
    assert sorted(s.number for s in second) == [4, 5]
    assert again.samples == fresh.samples
    assert [row["number"] for row in stored_samples(Path(path))] == list(range(6))


@pytest.mark.parametrize("record", ["{}", "[]", "7", '{"number": 1}', '{"number": "x"}'])
def test_a_damaged_sample_is_named(tmp_path: Path, record: str) -> None:
    scene, file = scene_file(tmp_path), tmp_path / "a.sqlite"
    words = ("montecarlo", scene, "-n", "3", "--jobs", "1", "-o", str(file), "--json")
    taction(*words)
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("update points set record = ?", (record,))
    again = taction(*words)
    assert again.exit_code == 2
    assert "the database is damaged and was not changed" in again.stderr


def test_sweep_and_samples_share_a_file(tmp_path: Path) -> None:
    scene, file = scene_file(tmp_path), str(tmp_path / "a.sqlite")
    samples = ("montecarlo", scene, "-n", "3", "--jobs", "1", "-o", file, "--json")
    first = json.loads(taction(*samples).stdout)
    words = ("--over", "C=50p,60p", "--engine", "statespace", "--jobs", "1", "-o", file, "--json")
    swept = json.loads(taction("sweep", scene, *words).stdout)
    assert (swept["ran"], len(swept["points"])) == (2, 2)
    assert json.loads(taction(*samples).stdout) == first


REAL: dict[str, Any] = {
    "capacitance": "100pF",
    "gain": "100kohm",
    "stray_capacitance": 0,
    "opamp": {"base": "ideal", "gbw": "50MHz", "voltage_noise": "10nV/rtHz"},
}
LIMIT = {"steady_state": {"tolerance": 0.5}, "settling_time": {"band": 0.5}}


def scene(volts: float | None) -> Scene:
    noise = {} if volts is None else {"noise": {"max": volts}}
    tolerances = QUIET | {"resistor": 0.05, "capacitor": 0.2}
    return small_scene(design=REAL, checks=LIMIT | noise, tolerances=tolerances)


def test_a_sample_has_the_noise_of_its_board() -> None:
    study = prepare(scene(1e-3))
    z = draw(study.scene.tolerances, study.varied, 3, 4)
    sample = evaluate(study, 4, z)
    rms, _ = output_noise(LinearBoard(vary(study.nominal, study.scene.tolerances, z)))
    assert sample.value("noise") == pytest.approx(rms.max(), rel=1e-9)
    assert "noise" in {quantity.name for quantity in quantities(study.scene)}


def test_the_spread_has_the_limit() -> None:
    nominal = prepare(scene(1e-3))
    middle = evaluate(nominal, 0, np.zeros(len(nominal.varied))).value("noise")
    study = prepare(scene(middle))
    tolerances = study.scene.tolerances
    samples = [evaluate(study, k, draw(tolerances, study.varied, 1, k)) for k in range(40)]
    failing = [sample for sample in samples if sample.failed == ("noise",)]
    assert 5 < len(failing) < 35
    report = summarise_samples(study, samples, 1)
    spread = next(each for each in report.quantities if each.name == "noise")
    assert (spread.unit, spread.at_most, spread.missing) == ("V", middle, 0)
    assert spread.low < middle < spread.high


def test_a_point_of_a_sweep_has_it_and_the_table_a_column() -> None:
    limited = scene(1e-3)
    verdict = verify(limited)
    assert Record.of(verdict).value("noise") == pytest.approx(max(verdict.noise.rms), rel=1e-12)
    assert Record.of(verify(scene(None))).value("noise") is None
    assert columns_of(limited)[-1] == "noise"
    assert "noise" not in columns_of(scene(None))


def worst(found: tuple[Corner, ...], quantity: str) -> float:
    corner = next(corner for corner in found if corner.quantity == quantity)
    value = corner.result.value(quantity)
    assert isinstance(value, float)
    return value


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
