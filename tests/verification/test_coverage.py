"""Stated uncertainties of random boards against their true errors.

The oracle reads the deck's text. `scripts/coverage_study.py` does the same for hundreds of boards.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.random_scenes import random_scene, random_setting
from tests.support.true_values import true_values
from verification.studies.stress.compare import compare
from verification.verify import verify

SEEDS = (0, 1, 2, 3, 5, 7, 8, 9, 10, 14, 18, 20)  # stable boards whose runs are short
TIMES = ("settling_time", "rise_time")
READINGS = ("settling_time", "rise_time", "overshoot", "undershoot", "steady_state")


@pytest.mark.usefixtures("ngspice")
def test_the_uncertainties_of_linear_boards_cover_their_errors() -> None:
    ratios: list[float] = []
    for seed in SEEDS:
        scene = random_scene(seed, topology="integrator", **random_setting(seed))
        truth = true_values(scene)
        for engine in ("ngspice", "statespace"):
            verdict = verify(scene.with_engine(engine))
            for check in verdict.checks:
                assert check.value is None or check.uncertainty is None or check.uncertainty > 0.0
            compared = compare(verdict, truth)
            assert not [c for c in compared if c.wrong]
            assert not [c for c in compared if c.outside and c.name.startswith(TIMES)]
            if engine == "ngspice":
                known = [c for c in compared if c.error > 2.0 * c.doubt]
                ratios += [c.uncertainty / c.error for c in known if c.name.startswith(READINGS)]
    assert len(ratios) > 50
    assert np.median(ratios) < 1.5
