"""Strongly driven boards of every amplifier and of op-amps at their limits, beside their decks."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.scene import Scene
from taction.verification.evidence.stress.judge import compare, wrong_checks
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.support.true_values import true_values

KINDS = (
    ("saturation", "small-signal"),
    ("deadzone", "small-signal"),
    ("rectifier", "small-signal"),
    ("exponential", "small-signal"),
    ("sinh", "small-signal"),
    ("linear", "large-signal"),
    ("saturation", "large-signal"),
    ("exponential", "large-signal"),
)
OPAMPS = ("tl084", "opa2134", "ua741")
SEEDS = (1, 3, 4, 32, 218, 361, 657, 20048, 31100)
"""Bounds of the last five were too small by 1.1 to 3.5: two runs erred alike."""
RESTS = 3  # numbers of a verdict without readings


def driven(seed: int) -> Scene:
    """Draw a board of one to three channels whose amplifiers or op-amps are driven far."""
    rng, (amplifier, level) = np.random.default_rng(10_000 + seed), KINDS[seed % len(KINDS)]
    count = int(rng.integers(1, 4))
    return Scene.from_arrays(
        rng.normal(size=(count, count)),
        10.0 ** rng.uniform(-0.5, 1.5) * rng.normal(size=count),
        amplifier=amplifier,
        lam=10.0 ** rng.uniform(-2.0, 0.0),
        capacitance=10.0 ** rng.uniform(-11.5, -9.5),
        gain=10.0 ** rng.uniform(4.5, 6.0),
        unit_conductance=10.0 ** rng.uniform(-6.0, -5.0),
        stray_capacitance=2e-12,
        opamp={
            "base": OPAMPS[int(rng.integers(len(OPAMPS)))],
            "input_errors": "none",
            "level": level,
        },
        engine="statespace",
        overshoot={"max": float(10.0 ** rng.uniform(-3.0, -0.5))},
        undershoot={"max": float(10.0 ** rng.uniform(-3.0, -0.5))},
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_numbers_and_checks_of_a_driven_board_are_those_of_its_deck(seed: int) -> None:
    scene = driven(seed)
    verdict, truth = verify(scene), true_values(scene)
    found = compare(verdict, truth)
    assert [n.name for n in found if n.outside] == []
    assert list(wrong_checks(verdict, truth)) == []
    assert len(found) > RESTS or verdict.outcome is Outcome.INCONCLUSIVE
