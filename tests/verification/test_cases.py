"""Scenes that were once judged wrongly; the true values are from the deck's text at 200 bits."""

from __future__ import annotations

import pytest

from netlist_gen.scene.file import load_scene
from tests.support.paths import DATA
from verification.pipeline.checks import Check, Outcome
from verification.verify import Verdict, verify

ENGINES = ("ngspice", "statespace")


def verdict_of(name: str, engine: str) -> Verdict:
    return verify(load_scene(DATA / "cases" / f"{name}.toml").with_engine(engine))


def named(verdict: Verdict, name: str) -> Check:
    return next(check for check in verdict.checks if check.name == name)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("name", "swing"),
    [("wrong-way-minus", 0.393), ("wrong-way-plus", 0.393), ("wrong-way-small-step", 0.354)],
)
def test_a_swing_counts_on_either_side_of_a_small_step(
    name: str, swing: float, engine: str
) -> None:
    """One waveform: the sign of a target of 1e-9 decides nothing."""
    over = named(verdict_of(name, engine), "overshoot")
    assert over.outcome is Outcome.FAIL
    assert over.value == pytest.approx(swing, rel=2e-3)
