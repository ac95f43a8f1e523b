"""Scenes that were once judged wrongly; the true values are from the deck's text at 200 bits."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.verification.design.tune import tune
from taction.verification.evidence.stress.catalogue import load_catalogue, select
from taction.verification.evidence.stress.run_cases import CaseJudgement, run_case
from taction.verification.studies.tolerance.montecarlo import prepare
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import Verdict, verify
from tests.support.measured import named
from tests.support.paths import CASES, DATA

PASS, FAIL, INCONCLUSIVE = Outcome.PASS, Outcome.FAIL, Outcome.INCONCLUSIVE
ENGINES = pytest.mark.parametrize("engine", ["ngspice", "statespace"])
STRAIGHT = DATA / "straight"
CATALOGUED = (
    *("wrong-way-minus", "wrong-way-plus", "wrong-way-small-step", "stop-on-a-zero"),
    *("stop-on-a-zero-long", "unstable-by-1e-4", "unstable-ten-minutes", "point-cap"),
    *("auto-stop-offset", "auto-stop-too-short", "loose-error-settling", "coarse-points-rise"),
    *("overshoot-after-band", "overshoot-zero", "rise-wide-band"),
)
LOW, HIGH = 1.1153e-9, 1.2547e-9  # F: between them the board of `margin-window` is unstable


def case(name: str) -> Scene:
    folder = STRAIGHT if name.startswith("saturation") else CASES
    return load_scene(folder / f"{name}.toml")


def verdict_of(name: str, engine: str) -> Verdict:
    return verify(case(name).with_engine(engine))


def test_a_sample_of_a_tolerance_study_finds_the_window() -> None:
    scene = case("margin-window").model_copy(update={"tolerances": Tolerances(resistor=0.01)})
    board = prepare(scene)
    sample = board.measured(0, np.zeros(len(board.varied)))
    assert sample.outcome == "fail"
    assert sample.record.value("margin") == pytest.approx(1.53e-9 / HIGH, rel=1e-4)


def test_tuning_keeps_away_from_the_window() -> None:
    tuning = tune(case("margin-window"), over="C", overshoot=0.9, margin=2.0)
    assert tuning.before.record.failed == ("stability",)
    farads = tuning.after.values["design.capacitance"]
    assert farads / 2.0 > HIGH or farads < LOW


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", CATALOGUED)
def test_a_case_of_the_catalogue_has_its_outcomes_and_its_true_values(name: str) -> None:
    (case,) = select(load_catalogue(), (name,))
    for engine in case.outcome:
        found = run_case(case, engine)
        assert found.judgement is CaseJudgement.RIGHT, found.reason
        assert [each.name for each in found.comparisons if each.outside] == []


@ENGINES
@pytest.mark.usefixtures("ngspice")
def test_a_step_of_rounding_is_nothing_to_judge(engine: str) -> None:
    verdict = verdict_of("nothing-moves", engine)
    assert verdict.outcome is INCONCLUSIVE
    for name in ("steady_state", "settling_time", "overshoot"):
        assert named(verdict, name).reason.startswith("nothing to judge")
    if engine == "ngspice":  # two engines can still agree that nothing moves
        assert named(verdict, "engines_agree").outcome is PASS


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
