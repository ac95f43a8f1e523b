"""Recording a transient: its readings, the error that it reached, and what is repeated."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import EngineError, InputError, StepTooSmall
from taction.system.progress import Clock
from taction.system.waveforms import Waveforms
from taction.verification.engines.statespace.transients import simulate
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.verdict import companion, recording, transient_plan
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.companion import Companion, outputs
from taction.verification.verdict.plan_board import design_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.recording import (
    Accuracy,
    Recording,
    better_plan,
    record_and_measure,
)
from taction.verification.verdict.simulation import Pending, StateSpaceError, choose_engine
from taction.verification.verdict.transient_plan import AIM, TransientPlan, state_space_tolerance
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene, ringing_scene
from tests.support.paths import SCENES

DOUBT = 1e-6  # V, of the other record


@cache
def board() -> tuple[PlannedBoard, IdealAnswer, Waveforms]:
    """The shipped breadboard, its reference and its exact transient."""
    file = SCENES / "paper-breadboard.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    data["analysis"] = data.get("analysis", {}) | {"engine": "ngspice"}
    design = design_board(parse_scene(data, file), Clock(lambda stage: None))
    ideal = ideal_answer(design.network, design.scene)
    times = np.linspace(0.0, design.transient.stop, 30_001)
    return design, ideal, simulate.simulate(design.board, design.transient, times=times)


def cut(waveforms: Waveforms, stop: float) -> Waveforms:
    kept = int(np.searchsorted(waveforms.time, stop, side="right"))
    return replace(waveforms, time=waveforms.time[:kept], values=waveforms.values[:kept])


def recorded(
    fine: Waveforms, other: Waveforms, stop: float, monkeypatch: pytest.MonkeyPatch
) -> Recording:
    """Measure `fine` beside `other`, the record of a board that has no exact solution."""
    design, ideal, _ = board()
    transient = replace(design.plan.transient, stop=stop)
    design = replace(design, plan=replace(design.plan, transient=transient))
    u, values = outputs(design.circuit, fine)[: len(other.time)], outputs(design.circuit, other)
    error = StateSpaceError(DOUBT, "", other)
    beside = Companion(other.time, u, values, other, error, "")
    monkeypatch.setattr(recording, "find_companion", lambda *_: beside)
    monkeypatch.setattr(companion, "is_exact", lambda _: False)
    monkeypatch.setattr(recording, "better_plan", lambda *_: None)
    clock = Clock(lambda stage: None)
    pending = Pending(lambda: replace(fine, engine="ngspice"))
    return record_and_measure(design, ideal, pending, clock)


def test_all_errors_follow_from_the_other_record(monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, whole = board()
    stop = float(whole.time[-1])
    shifted = replace(whole, values=whole.values * (1 + 3e-4))
    found = recorded(whole, shifted, stop, monkeypatch)
    # All outputs are 3e-4 of themselves apart, and the largest difference counts.
    largest = max(abs(c.final) for c in found.measurements.channels)
    error = (3e-4 * largest + DOUBT) / found.measurements.amplitude
    assert found.error.steady_state == pytest.approx(error, rel=1e-9)
    assert 0 < found.error.readings["settling_time"] < 1e-2 * found.measurements.settling_time.value


def test_two_records_that_prove_nothing_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both end just inside their bands: readings are there, but no proof of settling."""
    _, _, whole = board()
    settled = recorded(whole, whole, float(whole.time[-1]), monkeypatch)
    part = cut(whole, 1.01 * settled.measurements.settling_time.value)
    stop = float(part.time[-1])
    found = recorded(part, part, stop, monkeypatch)
    assert found.measurements.settling_time is None
    assert found.error.readings["settling_time"] == 0.0


def test_a_record_that_settles_beside_one_that_does_not_leaves_it_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, _, whole = board()
    stop = float(whole.time[-1])
    short = cut(whole, 0.9 * stop)  # it ends before the stop time, so it proves nothing
    found = recorded(whole, short, stop, monkeypatch)
    assert found.measurements.settling_time is not None
    assert found.error.readings["settling_time"] == math.inf
    assert math.isfinite(found.error.readings["rise_time"])


def test_error_and_points_exclude_each_other() -> None:
    with pytest.raises(InputError, match=r"'error' excludes 'points_per_period'"):
        make_scene(analysis={"error": 1e-4, "points_per_period": 125})
    with pytest.raises(InputError, match="error"):
        make_scene(analysis={"error": 1.5})


def test_auto_takes_the_cheapest_engine_unless_both_are_to_be_compared(ngspice: str) -> None:
    assert choose_engine(ringing_scene()) == "ngspice"
    assert choose_engine(ringing_scene(error=1e-4)) == "statespace"
    assert choose_engine(ringing_scene(error=1e-4, engine="ngspice")) == "ngspice"
    compared = make_scene(analysis={"error": 1e-4}, checks={"engines_agree": {"tolerance": 1e-3}})
    assert choose_engine(compared) == "ngspice"


@pytest.mark.parametrize("wanted", [1e-2, 1e-3, 1e-4])
def test_ngspice_reaches_the_error_and_states_it(ngspice: str, wanted: float) -> None:
    verdict = verify(ringing_scene(error=wanted, engine="ngspice"))
    found = verdict.accuracy
    assert found.tries == 1
    assert found.reached
    assert found.method == "trapezoidal"
    wave = verdict.waveforms
    exact = exact_solution(verdict.circuit)
    signs = np.array([output.sign for output in verdict.circuit.outputs])
    off = outputs(verdict.circuit, wave) - signs * exact.at(np.asarray(wave.time))
    error, bound = float(np.abs(off).max()), found.achieved * verdict.measurements.amplitude
    assert error <= bound <= (1.0 + 1e-6) * error + 2.0 * exact.error
    assert exact.error < 1e-4 * error
    assert 0.3 * wanted < found.achieved <= wanted


def test_a_step_that_misses_is_refined(ngspice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first run is planned for three times the wanted error, and a second run follows."""
    monkeypatch.setattr(transient_plan, "AIM", 3.0)
    verdict = verify(ringing_scene(error=1e-4, engine="ngspice"))
    found = verdict.accuracy
    assert found.tries == 2
    assert found.reached
    assert found.seconds > verdict.waveforms.cost.seconds
    document = json.loads(json.dumps(verdict_document(verdict)["accuracy"]))
    assert {"wanted", "achieved", "seconds", "points"} <= document.keys()
    assert document["wanted"] == 1e-4


def test_a_record_stays_where_its_repeat_fails(
    ngspice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verdict is that of the first run, and says why there is no better one."""
    design, ideal, _ = board()
    rough = replace(design.plan, wanted=1e-3 * design.plan.wanted)
    begin, plans = recording.begin, list[TransientPlan]()

    def second_fails(asked: PlannedBoard) -> Pending:
        plans.append(asked.plan)
        if len(plans) > 1:
            raise StepTooSmall("the time step fell below the limit\nthe log says: ...")
        return begin(asked)

    monkeypatch.setattr(recording, "begin", second_fails)
    found = record_and_measure(replace(design, plan=rough), ideal, None, Clock(lambda stage: None))
    assert len(plans) == 2
    assert found.achieved is not None
    assert found.achieved > rough.wanted
    assert (
        "the readings are of the run before it: the time step fell below the limit"
        in (found.ends.flags[-1])
    )


def test_a_board_that_the_other_engine_cannot_answer_runs_twice(
    ngspice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The difference of two runs bounds the error, which is about a third of the difference."""

    def no_answer(*_: object, **__: object) -> None:
        raise EngineError("no answer")

    monkeypatch.setattr(simulate, "simulate", no_answer)
    verdict = verify(ringing_scene(error=1e-3, engine="ngspice"))
    found = verdict.accuracy
    assert "twice the step" in found.how
    wave = verdict.waveforms
    truth = exact_solution(verdict.circuit).at(np.asarray(wave.time))
    signs = np.array([output.sign for output in verdict.circuit.outputs])
    error = np.abs(outputs(verdict.circuit, wave) - signs * truth).max()
    ratio = found.achieved * verdict.measurements.amplitude / error
    assert 1.0 < ratio < 4.0
    assert math.isfinite(verdict.error.readings["settling_time"])
    agree = next(check for check in verdict.checks if check.name == "engines_agree")
    assert agree.outcome is Outcome.INCONCLUSIVE
    assert "no answer" in agree.reason


def test_a_record_is_as_long_as_a_channel_needs_to_settle(ngspice: str) -> None:
    """A narrow band: the last ringing leaves it long after the steady state is near enough.

    The plan of the record knows the band, so that no second run is needed.
    """
    scene = ringing_scene(engine="ngspice")
    off = verify(scene).measurements
    static = max(abs(c.final - c.target) for c in off.channels) / off.amplitude
    checks = {"settling_time": {"band": 3.0 * static}, "steady_state": {"tolerance": 0.5}}
    data = scene.model_dump(by_alias=True) | {"checks": checks}
    verdict = verify(Scene.model_validate(data))
    assert verdict.measurements.settling_time is not None
    assert verdict.accuracy.tries == 1


def test_the_state_space_states_what_it_reached() -> None:
    linear = verify(ringing_scene(error=1e-6, engine="statespace")).accuracy
    assert linear.method == "exact"
    assert linear.achieved < 1e-9
    scene = load_scene(SCENES / "paper-exponential.toml")
    analysis = {"error": 1e-4, "stop": 1e-4, "engine": "statespace"}
    scene = scene.model_copy(update={"analysis": scene.analysis.model_copy(update=analysis)})
    curved = verify(scene).accuracy
    assert curved.reached
    assert curved.method == "Radau IIA"


def test_tolerances_stay_where_an_engine_can_follow() -> None:
    assert state_space_tolerance(1e-4) == pytest.approx(2e-5)
    assert state_space_tolerance(1e-15) == 1e-10
    assert state_space_tolerance(0.5) == 1e-3


TRIED = Accuracy(1e-4, 4e-4, 2.0, 1000, 100.0, "ngspice-46", "trapezoidal", "")


def test_only_a_known_miss_of_a_stepping_engine_is_tried_again() -> None:
    design = design_board(ringing_scene(error=1e-4, engine="ngspice"), Clock(lambda stage: None))
    ideal = ideal_answer(design.network, design.scene)
    done = verify(ringing_scene(engine="statespace")).recording  # every channel settles
    run = replace(done.ends, engine="ngspice-46")
    tried = replace(done, design=design, ends=run)

    def again(achieved: float | None, ends: Waveforms = run) -> TransientPlan | None:
        volts = math.nan if achieved is None else achieved * done.measurements.amplitude
        return better_plan(replace(tried, ends=ends, attained=(volts, "", "")), ideal)

    plan = again(4e-4)
    # The forecast was four times too small, so the next aim is four times smaller.
    aim = AIM * 1e-4 * design.plan.forecast.error / 4e-4
    assert 0.5 * aim < plan.forecast.error <= aim
    assert plan.transient.stop == design.transient.stop
    assert again(1e-5) is None
    assert again(None) is None
    assert again(4e-4, done.ends) is None
    both = replace(TRIED, seconds=3.0).after(TRIED)
    assert (both.seconds, both.tries) == (5.0, 2)


@pytest.mark.parametrize("count", [9, 20, 21, 22, 61])
def test_a_thinned_companion_keeps_both_ends(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """The last instant proves that a record is whole, whatever its number of points."""
    monkeypatch.setattr(companion, "MAX_INSTANTS", 10)
    design = design_board(ringing_scene(engine="ngspice"), Clock(lambda stage: None))
    times = np.linspace(0.0, design.transient.stop, count)
    record = simulate.simulate(design.board, design.transient, times=times)
    found = companion.state_space_companion(design.board, design.transient, record, 1e-6)
    assert (found.instants[0], found.instants[-1]) == (times[0], times[-1])
    assert np.all(np.diff(found.instants) > 0.0)
    assert len(found.instants) <= 21
    assert found.difference == 0.0
    assert 0.0 < found.doubt < 1e-9


def test_a_dip_between_the_points_of_a_record_is_a_difference() -> None:
    """The true undershoot of this board is 0.743902 % (SciPy on its deck), at 0.2 us."""
    board = Path(__file__).parents[2] / "data/straight/saturation-passes.toml"
    design = design_board(load_scene(board), Clock(lambda stage: None))
    ends = np.linspace(0.0, design.transient.stop, 3)
    whole = simulate.simulate(design.board, design.transient, times=ends, resolved=True)
    u = companion.outputs(design.circuit, whole)
    times = np.concatenate([[0.0], whole.time[whole.time > 1e-6]])
    record = simulate.simulate(design.board, design.transient, times=times)
    found = companion.state_space_companion(design.board, design.transient, record, 1e-9)
    assert found.difference > 0.007 * np.abs(u[-1] - u[0]).max()
