"""Scenes that were once judged wrongly; the true values are from the deck's text at 200 bits."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.checks import Tolerances
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.design.tune import tune
from taction.verification.studies.tolerance.samples import evaluate
from taction.verification.studies.tolerance.varied_board import prepare
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.verify import Verdict, verify
from tests.support.paths import CASES, DATA

PASS, FAIL, INCONCLUSIVE = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE
ENGINES = pytest.mark.parametrize("engine", ["ngspice", "statespace"])
STRAIGHT = DATA / "straight"
LOW, HIGH = 1.1153e-9, 1.2547e-9  # F: between them the board of `margin-window` is unstable


def case(name: str) -> Scene:
    folder = STRAIGHT if name.startswith("saturation") else CASES
    return load_scene(folder / f"{name}.toml")


def verdict_of(name: str, engine: str) -> Verdict:
    return verify(case(name).with_engine(engine))


def named(verdict: Verdict, name: str) -> Check:
    return next(check for check in verdict.checks if check.name == name)


def test_a_sample_of_a_tolerance_study_finds_the_window() -> None:
    scene = case("margin-window").model_copy(update={"tolerances": Tolerances(resistor=0.01)})
    board = prepare(scene)
    sample = evaluate(board, 0, np.zeros(len(board.varied)))
    assert sample.outcome == "fail"
    assert sample.record.value("margin") == pytest.approx(1.53e-9 / HIGH, rel=1e-4)


def test_tuning_keeps_away_from_the_window() -> None:
    tuning = tune(case("margin-window"), over="C", overshoot=0.9, margin=2.0).tuning
    assert tuning.before.left == ("stability",)
    for candidate in tuning.frontier:
        farads = candidate.values["design.capacitance"]
        assert farads / 2.0 > HIGH or farads < LOW


@ENGINES
@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    ("name", "swing"),
    [("wrong-way-minus", 0.393), ("wrong-way-plus", 0.393), ("wrong-way-small-step", 0.354)],
)
def test_a_swing_counts_on_either_side_of_a_small_step(
    name: str, swing: float, engine: str
) -> None:
    """One waveform: the sign of a target of 1e-9 decides nothing."""
    over = named(verdict_of(name, engine), "overshoot")
    assert over.outcome is FAIL
    assert over.value == pytest.approx(swing, rel=2e-3)


@ENGINES
@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", ["stop-on-a-zero", "stop-on-a-zero-long"])
def test_the_equilibrium_decides_wherever_the_record_ends(name: str, engine: str) -> None:
    check = named(verdict_of(name, engine), "steady_state")
    assert check.outcome is FAIL
    assert check.value == pytest.approx(2.92e-4, rel=2e-3)


@ENGINES
@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    ("name", "growth"), [("unstable-by-1e-4", 69.9), ("unstable-ten-minutes", 2144.0)]
)
def test_the_poles_decide_before_the_instability_has_grown(
    name: str, growth: float, engine: str
) -> None:
    verdict = verdict_of(name, engine)
    assert {check.outcome for check in verdict.checks} == {FAIL}
    assert named(verdict, "stability").value == pytest.approx(growth, rel=1e-3)


@ENGINES
@pytest.mark.usefixtures("ngspice")
def test_a_step_of_rounding_is_nothing_to_judge(engine: str) -> None:
    verdict = verdict_of("nothing-moves", engine)
    assert verdict.outcome is INCONCLUSIVE
    for name in ("steady_state", "settling_time", "overshoot"):
        assert named(verdict, name).reason.startswith("nothing to judge")
    if engine == "ngspice":  # two engines can still agree that nothing moves
        assert named(verdict, "engines_agree").outcome is PASS


def test_the_exact_solution_needs_no_points() -> None:
    """Equal steps over this record would be more than 2 million points."""
    verdict = verdict_of("point-cap", "statespace")
    assert verdict.outcome is PASS
    assert named(verdict, "settling_time").value == pytest.approx(0.06969216823, rel=1e-8)


@ENGINES
@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    ("name", "seconds"), [("auto-stop-offset", 84.28e-6), ("auto-stop-too-short", 15.03e-6)]
)
def test_an_automatic_record_is_long_enough(name: str, seconds: float, engine: str) -> None:
    verdict = verdict_of(name, engine)
    settling = named(verdict, "settling_time")
    assert verdict.outcome is PASS
    assert abs(settling.value - seconds) <= settling.uncertainty + 0.005e-6  # digits of the truth


@ENGINES
@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    ("name", "check", "value", "digits"),
    [
        ("loose-error-settling", "settling_time", 94.57504e-6, 1e-7),
        ("coarse-points-rise", "rise_time", 39.945670443e-6, 1e-10),
        ("overshoot-after-band", "overshoot", 0.0775271915419, 1e-12),
        ("overshoot-zero", "overshoot", 0.0070709023014, 1e-10),
        ("rise-wide-band", "rise_time", 29.368834181e-6, 1e-10),
    ],
)
def test_a_reading_is_within_its_uncertainty_of_the_truth(
    name: str, check: str, value: float, digits: float, engine: str
) -> None:
    found = named(verdict_of(name, engine), check)
    assert abs(found.value - value) <= found.uncertainty + digits * value
    assert found.uncertainty < (0.02 if engine == "ngspice" else 1e-8) * value
    if found.expected is not None:
        right = PASS if value <= found.expected else FAIL
        assert found.outcome in ({right, INCONCLUSIVE} if engine == "ngspice" else {right})


@ENGINES
@pytest.mark.usefixtures("ngspice")
def test_a_channel_rises_long_after_the_board_has_settled(engine: str) -> None:
    """The band is wider than what the first channel has left to go.

    The true value is that of the small-signal board; a real NE5534 slews.
    """
    scene = with_values(case("rise-after-band"), {"design.opamp.level": "small-signal"})
    rise = verify(scene.with_engine(engine)).measurements.channels[0].rise_time
    assert abs(rise.value - 113.906e-6) <= rise.uncertainty + 1e-9
    assert rise.uncertainty < 2e-3 * rise.value


def test_readings_are_seen_where_amplifiers_saturate_at_rest() -> None:
    """It passed: the points of the record were those of the modes at rest, which are slow."""
    verdict = verdict_of("saturation-passes", "statespace")
    assert verdict.outcome is FAIL
    settled, under = (named(verdict, name) for name in ("settling_time", "undershoot"))
    assert abs(settled.value - 4.689117521e-6) <= settled.uncertainty + 1e-15
    assert abs(under.value - 0.00743902) <= under.uncertainty + 1e-8
    third = verdict_of("saturation-settling", "statespace").measurements.channels[2]
    settled = third.readings["settling_time"]
    assert abs(settled.value - 340.9034e-9) <= settled.uncertainty + 1e-13
    assert settled.uncertainty < 1e-11
