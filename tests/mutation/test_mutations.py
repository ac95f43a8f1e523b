"""Every planted fault is caught by the verdict of a shipped scene, by the check that is named."""

from __future__ import annotations

import pytest

from netlist_gen.scene.file import load_scene
from tests.mutation.catalogue import MUTATIONS, Mutation
from tests.mutation.planting import nothing
from tests.mutation.table import PAGE, page_with
from tests.support.paths import SCENES
from verification.pipeline.checks import Outcome
from verification.verify import Verdict

pytestmark = pytest.mark.usefixtures("ngspice")

VERIFIED = sorted({(mutation.scene, mutation.engine) for mutation in MUTATIONS})


def judge(mutation: Mutation) -> Verdict:
    scene = load_scene(SCENES / f"{mutation.scene}.toml").with_engine(mutation.engine)
    with pytest.MonkeyPatch.context() as patch:
        return mutation.plant(scene, patch)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: f"{m.where}: {m.fault}")
def test_a_planted_fault_is_caught(mutation: Mutation) -> None:
    verdict = judge(mutation)
    outcomes = {check.name: check.outcome for check in verdict.checks}
    assert verdict.outcome is not Outcome.PASS
    assert {outcomes.get(name) for name in mutation.caught_by} == {Outcome.FAIL}, outcomes


@pytest.mark.parametrize(("scene", "engine"), VERIFIED)
def test_without_a_fault_the_scene_passes(scene: str, engine: str) -> None:
    verdict = judge(Mutation("", "", nothing, scene, engine, ()))
    assert {check.outcome for check in verdict.checks} == {Outcome.PASS}


def test_the_page_shows_the_catalogue() -> None:
    text = PAGE.read_text("utf-8")
    assert page_with(text) == text, "run: python -m tests.mutation.table"


def test_every_kind_of_check_catches_a_fault() -> None:
    catching = {name for mutation in MUTATIONS for name in mutation.caught_by}
    assert catching >= {"steady_state", "settling_time", "rise_time", "overshoot", "stability"}
    assert catching >= {"engines_agree", "same_problem"}
