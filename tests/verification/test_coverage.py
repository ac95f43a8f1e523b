"""Stated uncertainties of random boards against their true errors.

The oracle reads the deck's text. `make proof ARGS=coverage` does the same for 200 boards.
"""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.evidence.stress.judge import TruthComparison, compare
from taction.verification.verdict.verify import verify
from tests.support.fine_readings import fine_readings
from tests.support.random_scenes import random_scene, random_setting
from tests.support.true_values import true_values

SEEDS = (0, 1, 2, 3, 5, 7, 8, 9, 10, 14, 18, 20)  # stable boards whose runs are short
EXPONENTIAL = (0, 2, 3, 5, 7, 11, 12, 13, 14, 15, 17, 18, 27)  # the same, of boards with amplifiers
LOOSE = 0.01  # analysis.error: far above the error of the run that counts as true
READINGS = ("settling_time", "rise_time", "overshoot", "undershoot", "steady_state")
COVERED, TIGHT = 0.99, 5.0  # share of the numbers; times the true error: median of the bounds
TAIL = 1e-5  # of the step: a larger bound is of what may follow the record
LEVEL = 1e-6  # of the step, or of a time: to this readings are known (docs/verdict.md)


def check_coverage(compared: list[TruthComparison]) -> None:
    assert not [c for c in compared if c.wrong]
    assert sum(not c.outside for c in compared) >= COVERED * len(compared)


def ratios(compared: list[TruthComparison]) -> list[float]:
    """Return uncertainty over error of the readings whose error the truth resolves."""
    readings = [c for c in compared if c.name.startswith(READINGS) and c.error > 2.0 * c.doubt]
    return [c.uncertainty / c.error for c in readings]


@pytest.mark.usefixtures("ngspice")
def test_the_uncertainties_of_linear_boards_cover_their_errors() -> None:
    by_engine: dict[str, list[TruthComparison]] = {"ngspice": [], "statespace": []}
    for seed in SEEDS:
        scene = random_scene(seed, topology="integrator", **random_setting(seed))
        truth = true_values(scene)
        for engine, compared in by_engine.items():
            verdict = verify(scene.with_engine(engine))
            for check in verdict.checks:
                assert check.value is None or check.uncertainty is None or check.uncertainty > 0.0
            compared += compare(verdict, truth)
    for compared in by_engine.values():
        check_coverage(compared)
    found = ratios(by_engine["ngspice"])
    assert len(found) > 50
    assert np.median(found) < TIGHT
    times = [c for c in by_engine["statespace"] if c.unit == "s" and c.value]
    assert np.quantile([c.uncertainty / c.value for c in times], 0.9) < LEVEL


def test_the_uncertainties_of_boards_with_amplifiers_cover_their_errors() -> None:
    """Also where the checks allow far more, readings are found to 1e-6: times to as much of them.

    They err by less than the finer run resolves, so bounds are not compared with errors.
    """
    compared: list[TruthComparison] = []
    for seed in EXPONENTIAL:
        scene = random_scene(seed, "exponential", topology="integrator", error=LOOSE)
        compared += compare(verify(scene.with_engine("statespace")), fine_readings(scene))
    check_coverage(compared)
    times = [c.uncertainty / c.value for c in compared if c.unit == "s" and c.value]
    assert np.median(times) < LEVEL
    assert np.quantile(times, 0.9) < 10.0 * LEVEL
    excursions = [c.uncertainty for c in compared if c.name.startswith(("overshoot", "undershoot"))]
    assert sum(each > TAIL for each in excursions) < 0.25 * len(excursions)
    assert max(each for each in excursions if each < TAIL) < LEVEL
