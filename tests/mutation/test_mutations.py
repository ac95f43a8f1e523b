"""Every planted fault is caught by the verdict of a shipped scene, by the check that is named."""

from __future__ import annotations

import pytest

from taction.netlist_gen.scene.scene import load_scene
from taction.verification.verdict import input_spread
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import Verdict
from tests.mutation.catalogue import KNOWN, MATRIX, MUTATIONS, STATE_SPACE, Mutation
from tests.mutation.planting import in_the_baseline, nothing
from tests.support.paths import SCENES
from tests.support.true_values import true_values

pytestmark = pytest.mark.usefixtures("ngspice")

VERIFIED = sorted({(mutation.scene, mutation.engine) for mutation in MUTATIONS})


def judge(mutation: Mutation) -> Verdict:
    scene = load_scene(SCENES / f"{mutation.scene}.toml").with_engine(mutation.engine)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(input_spread, "_FOUND", {})  # which boards of one process share
        return mutation.plant(scene, patch)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: f"{m.where}: {m.fault}")
def test_a_planted_fault_is_caught(mutation: Mutation) -> None:
    verdict = judge(mutation)
    outcomes = {check.name: check.outcome for check in verdict.checks}
    assert verdict.outcome is not Outcome.PASS
    assert {outcomes.get(name) for name in mutation.caught_by} == {mutation.outcome}, outcomes


@pytest.mark.parametrize(("scene", "engine"), VERIFIED)
def test_without_a_fault_the_scene_passes(scene: str, engine: str) -> None:
    verdict = judge(Mutation("", "", nothing, scene, engine, ()))
    assert {check.outcome for check in verdict.checks} == {Outcome.PASS}


def test_a_fresh_baseline_is_kept() -> None:
    verdict = judge(Mutation("", "", in_the_baseline(lambda s: s), MATRIX, STATE_SPACE, ()))
    assert verdict.checks[-1].name == "regression"
    assert verdict.outcome is Outcome.PASS


def test_known_readings_are_those_of_the_oracle() -> None:
    """The limits of the scene are 0.5 % and 0.3 % around the readings of the deck's equations."""
    scene = load_scene(SCENES / f"{KNOWN}.toml")
    truth, checks = true_values(scene), scene.checks
    rise, settling = (
        truth.channels[1]["rise_time"],
        max(each["settling_time"] for each in truth.channels),
    )
    assert settling is not None
    assert checks.rise_time is not None
    limits = checks.settling_time.min, checks.settling_time.max
    assert limits == (
        pytest.approx(0.995 * settling, rel=1e-4),
        pytest.approx(1.005 * settling, rel=1e-4),
    )
    limits = checks.rise_time.min, checks.rise_time.max
    assert limits == (pytest.approx(0.997 * rise, rel=1e-4), pytest.approx(1.003 * rise, rel=1e-4))


def test_every_kind_of_check_catches_a_fault() -> None:
    catching = {name for mutation in MUTATIONS for name in mutation.caught_by}
    assert catching >= {"steady_state", "settling_time", "rise_time", "overshoot", "stability"}
    assert catching >= {"engines_agree", "same_problem"}
