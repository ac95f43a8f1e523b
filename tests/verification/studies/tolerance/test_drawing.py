"""Samples in the database, and the noise of samples and points."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.variation import draw, vary
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.report.views.sweep_view import columns_of
from taction.verification.studies.running.store import Store
from taction.verification.studies.tolerance import montecarlo
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
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import verify
from tests.support.running import taction
from tests.support.studying import QUIET, one_thread, scene_file, small_scene, stored_samples
from tests.support.sweeping import make_sample

STUDY = prepare(small_scene())
SAMPLES = [
    make_sample(0, settling_time=1e-6),
    make_sample(2, "fail", ("stability",), margin=1.5),
]


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
