"""Strongly driven boards of straight amplifiers: every reading against their deck's text."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.scene import Scene
from taction.verification.evidence.stress.compare import compare, wrong_checks
from taction.verification.verdict.verify import verify
from tests.support.straight_oracle import straight_readings

SEEDS = (0, 2, 3, 5, 7, 8, 9)
"""The oracle refuses 4, which does not come to rest; no amplifier of 1 and 6 saturates."""


def driven(seed: int) -> Scene:
    """Draw a board of one or two channels, most of which saturate while they settle."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 3))
    return Scene.from_arrays(
        rng.normal(size=(count, count)),
        10.0 ** rng.uniform(-0.5, 1.5) * rng.normal(size=count),
        amplifier="saturation",
        lam=10.0 ** rng.uniform(-2.0, 0.0),
        capacitance=10.0 ** rng.uniform(-11.5, -9.5),
        gain=10.0 ** rng.uniform(5.0, 6.0),
        unit_conductance=10.0 ** rng.uniform(-6.0, -5.0),
        stray_capacitance=2e-12,
        opamp={"base": "tl084", "input_errors": "none", "level": "small-signal"},
        engine="statespace",
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_readings_of_a_driven_board_are_those_of_its_deck(seed: int) -> None:
    scene = driven(seed)
    truth, passages = straight_readings(scene)
    verdict = verify(scene)
    found = compare(verdict, truth)
    assert passages > 0
    assert len(found) == 3 + 5 * len(truth.channels)
    assert [each for each in found if each.outside] == []
    assert list(wrong_checks(verdict, truth)) == []
