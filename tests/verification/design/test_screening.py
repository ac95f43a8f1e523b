"""What a search sees of designs that fail by far: estimates beside verdicts, and what they find."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Output
from taction.netlist_gen.board.parts import OpAmpCell, VoltageSource
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.checks import ExcursionCheck
from taction.netlist_gen.scene.loading import load_scene
from taction.spice_models.opamp import OpAmp
from taction.verification.design.remedies import find_remedies
from taction.verification.design.screening import can_estimate, outlines
from taction.verification.design.trials import OutOfWorkError, Trials
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.support.boards import bare
from tests.support.paths import SCENES

PAPER = load_scene(SCENES / "paper-breadboard.toml").with_engine("statespace")


def test_the_outline_is_the_step_response_in_closed_form() -> None:
    zeta, omega = 0.3, 1e6
    gbw, second = omega / (4.0 * np.pi * zeta), zeta * omega / np.pi
    follower = bare(
        models={"op": OpAmp("op", 1e9, gbw=gbw, second_pole=second)},
        opamps=(OpAmpCell("X", "op", "in", "out", "out"),),
        voltages=(VoltageSource("V", "in", 1.0),),
        outputs=(Output("out", 1.0),),
    )
    (outline,) = outlines([LinearBoard(follower)], "zero")
    times = np.linspace(0.0, 20.0 / omega, 50)
    damped = np.sqrt(1.0 - zeta**2)
    angle = damped * omega * times
    ringing = np.cos(angle) + zeta / damped * np.sin(angle)
    expected = 1.0 - np.exp(-zeta * omega * times) * ringing
    assert outline.at(times)[:, 0] == pytest.approx(expected, abs=1e-8)
    assert outline.unstable() is None


@pytest.mark.parametrize("C", [8e-12, 1.1e-11, 2.2e-11, 1e-10, 1e-9])
@pytest.mark.parametrize("gain", [1e6, 6.252e6, 2e7])
def test_no_estimate_contradicts_a_verdict(C: float, gain: float) -> None:
    trials = Trials(PAPER, screened=True)
    found = trials.at({"design.capacitance": C, "design.gain": gain})
    judged = trials.verified(found)
    assert not judged.estimated
    if not found.estimated:
        return
    assert not judged.good
    for check in found.record.checks:
        verdict = judged.record.check(check.name)
        if check.outcome is Outcome.FAIL:
            assert verdict.outcome is not Outcome.PASS
        elif check.outcome is Outcome.PASS:
            assert verdict.outcome is Outcome.PASS
        if check.name == "rise_time" and None not in (check.value, verdict.value):
            assert check.value == pytest.approx(verdict.value, rel=2e-3)  # a fifth of `CLOSE`


@pytest.mark.parametrize(("C", "gain"), [(1.58e-11, 1e6), (5e-12, 6.81e5)])
def test_a_rise_far_beyond_its_limit_needs_no_verdict(C: float, gain: float) -> None:
    scene = with_values(PAPER, {"design.capacitance": 5e-12, "design.gain": 1e6})
    trials = Trials(scene, screened=True)
    found = trials.at({"design.capacitance": C, "design.gain": gain})
    assert found.estimated
    assert found.left == ("rise_time",)
    judged = trials.verified(found)
    assert judged.left == ("rise_time",)
    assert judged.reading("rise_time") > 2.0 * scene.checks.rise_time.max


def test_a_part_beyond_real_ones_needs_no_verdict() -> None:
    trials = Trials(PAPER, screened=True)
    judged = trials.verified(trials.at({"design.gain": 3.16e7}))
    assert judged.refused == "resistors s above 10 Mohm"
    assert judged.record.simulator is None
    assert not judged.estimated
    assert not judged.good


def test_an_unstable_design_fails_what_its_verdict_fails() -> None:
    changes = {"design.capacitance": 5e-12, "design.gain": 2e7}
    trials = Trials(PAPER, screened=True)
    verdict = verify(trials.scene_at(changes))
    failed = {check.name for check in verdict.checks if check.outcome is Outcome.FAIL}
    assert set(trials.at(changes).left) == failed
    assert {"stability", "overshoot"} <= failed


def test_estimates_change_no_proposal(monkeypatch: pytest.MonkeyPatch) -> None:
    checks = PAPER.checks.model_copy(
        update={"rise_time": None, "overshoot": ExcursionCheck(max=0.2)}
    )
    verdict = verify(PAPER.model_copy(update={"checks": checks}))
    assert verdict.outcome is Outcome.FAIL
    quick = find_remedies(verdict, 1e6)
    monkeypatch.setattr(Trials, "at", lambda self, changes: self._verdict_at(changes))
    monkeypatch.setattr(
        Trials,
        "_verdict_at",
        lambda self, changes: self._known.setdefault(
            tuple(sorted(changes.items())), self._try(dict(changes))
        ),
        raising=False,
    )
    slow = find_remedies(verdict, 1e6)
    assert quick.changes == slow.changes
    assert quick.without == slow.without


def test_designs_that_are_expected_have_the_trials_that_they_have_alone() -> None:
    several = [
        {"design.capacitance": C, "design.gain": gain}
        for C in (5e-12, 2.2e-11, 1e-9)
        for gain in (1e6, 2e7)
    ]
    together = Trials(PAPER, screened=True)
    together.expect([*several, {"design.capacitance": -1.0}])
    assert together.tried == ()
    for changes in several:
        assert together.at(changes).record == Trials(PAPER, screened=True).at(changes).record
    assert "capacitance" in together.at({"design.capacitance": -1.0}).refused


def test_nothing_is_expected_beyond_the_work() -> None:
    with pytest.raises(OutOfWorkError):
        Trials(PAPER, 0.0, screened=True).expect([{"design.gain": 1e6}])
    Trials(PAPER, 0.0).expect([{"design.gain": 1e6}])  # nothing is computed


def test_a_half_that_rests_is_seen_by_its_poles() -> None:
    """The load is even, so the odd half of the board rests, but it can be unstable."""
    (outline,) = outlines([LinearBoard(synthesise(PAPER))], "zero")
    even = LinearBoard(synthesise(PAPER)).state_space.blocks[0].A.shape[0]
    assert not outline.share[even:].any()
    expected = np.linalg.eigvals(LinearBoard(synthesise(PAPER)).state_space.A)
    assert np.sort(outline.poles.real) == pytest.approx(np.sort(expected.real), rel=1e-6)


def test_a_check_without_estimate_needs_verdicts() -> None:
    assert can_estimate(PAPER, ("settling_time", "stability"))
    assert not can_estimate(PAPER, ("noise",))
    margin = PAPER.checks.stability.model_copy(update={"margin": 2.0})
    checks = PAPER.checks.model_copy(update={"stability": margin})
    assert not can_estimate(PAPER.model_copy(update={"checks": checks}), ("stability",))
