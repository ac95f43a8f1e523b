"""The noise of samples and points, where the scene has a limit for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.variation import draw, vary
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.output_noise import output_noise
from taction.verification.report.views.sweep import columns_of
from taction.verification.studies.tolerance.varied_board import evaluate, prepare, quantities
from taction.verification.studies.tolerance.yield_forecast import YieldForecast
from taction.verification.studies.tolerance.yield_report import summarise_samples
from taction.verification.verdict.record import Record
from taction.verification.verdict.verify import verify
from tests.support.studying import QUIET, small_scene

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
    z = draw(study.scene.tolerances, len(study.varied), 3, 4)
    sample = evaluate(study, 4, z)
    rms, _ = output_noise(LinearBoard(vary(study.nominal, study.scene.tolerances, z)))
    assert sample.value("noise") == pytest.approx(rms.max(), rel=1e-9)
    assert "noise" in {quantity.name for quantity in quantities(study.scene)}


def test_the_spread_has_the_limit_and_a_remedy_counts_it() -> None:
    nominal = prepare(scene(1e-3))
    middle = evaluate(nominal, 0, np.zeros(len(nominal.varied))).value("noise")
    assert middle is not None
    study = prepare(scene(middle))
    tolerances, count = study.scene.tolerances, len(study.varied)
    samples = [evaluate(study, k, draw(tolerances, count, 1, k)) for k in range(40)]
    failing = [sample for sample in samples if sample.failed == ("noise",)]
    assert 5 < len(failing) < 35
    report = summarise_samples(study, samples, 1)
    spread = next(each for each in report.quantities if each.name == "noise")
    assert (spread.unit, spread.at_most, spread.missing) == ("V", middle, 0)
    assert spread.low < middle < spread.high
    forecast = YieldForecast.of(study, samples, 1)
    assert forecast.passes.tolist() == [sample.outcome == "pass" for sample in samples]


def test_without_a_limit_there_is_no_noise() -> None:
    study = prepare(scene(None))
    assert evaluate(study, 0, np.zeros(len(study.varied))).value("noise") is None
    assert "noise" not in {quantity.name for quantity in quantities(study.scene)}


def test_a_point_of_a_sweep_has_it_and_the_table_a_column() -> None:
    limited = scene(1e-3)
    verdict = verify(limited)
    assert verdict.noise is not None
    assert Record.of(verdict).value("noise") == pytest.approx(max(verdict.noise.rms), rel=1e-12)
    assert Record.of(verify(scene(None))).value("noise") is None
    assert columns_of(limited)[-1] == "noise"
    assert "noise" not in columns_of(scene(None))
