"""The pipeline, end to end, and the recording of a transient: what can go wrong with them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.errors import EngineError, StepTooSmall, TimedOut
from taction.system.progress import Clock
from taction.verification.engines.ngspice.process import find_simulator
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.readings.settling import ChannelState
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.verdict_view import view
from taction.verification.verdict import run as module
from taction.verification.verdict import transient_plan
from taction.verification.verdict.board import Board
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.run import Run, better_plan, observe, outputs
from taction.verification.verdict.simulation import Waiting, build, choose_engine
from taction.verification.verdict.transient_plan import TransientPlan
from taction.verification.verdict.verify import Verdict, verify
from tests.support import nightly
from tests.support.making import make_scene, ringing_scene
from tests.support.measured import named
from tests.support.paths import SCENES

NAMES = sorted(path.stem for path in SCENES.glob("*.toml"))
QUICK = ("custom-matrix", "eleven-channel", "ridge", "tangential-exponential", "tuned-breadboard")


def shipped(name: str, **tables: dict[str, Any]) -> Scene:
    """A shipped scene with some keys of its tables changed."""
    changes = {f"{table}.{key}": v for table, keys in tables.items() for key, v in keys.items()}
    return with_values(load_scene(SCENES / f"{name}.toml"), changes)


@cache
def verdict_of(name: str, engine: str) -> Verdict:
    return verify(shipped(name, analysis={"engine": engine}))


def assert_named(verdict: Verdict, other: Verdict) -> None:
    """A verdict names simulator with version, solver and method, as text and as JSON."""
    found = find_simulator()
    names = [f"ngspice-{found.version}", "KLU" if found.klu else "Sparse", "trapezoidal"]
    document = verdict_document(verdict)
    assert [document[key] for key in ("simulator", "solver", "method")] == names
    assert f"{', '.join(names)}: " in page_text(view(verdict))
    method = "exact" if other.scene.design.amplifier == "linear" else "Radau IIA"
    assert f"statespace, {method}: " in page_text(view(other))


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("name", [*QUICK, *nightly(*sorted({*NAMES} - {*QUICK}))])
def test_every_shipped_scene_passes_with_both_engines(name: str) -> None:
    """One test a scene: its verdicts are computed once. All are in `make regress`."""
    verdict, other = verdict_of(name, "ngspice"), verdict_of(name, "statespace")
    for found in (verdict, other):
        assert found.outcome is Outcome.PASS, str(found)
        assert_budget_adds_up(found)
    assert_named(verdict, other)


def assert_budget_adds_up(verdict: Verdict) -> None:
    parts = {part.name: part.value for part in verdict.budget if part.name != "noise"}
    assert ("antilog" in parts) is bool(verdict.circuit.transistors)
    assert ("wires" in parts) is not verdict.scene.wires.ideal
    assert parts.keys() >= {"regularisation", "strain_noise", "unsettled", "simulator"}
    stress = verdict.problem.stress
    final = np.array([channel.final for channel in verdict.measurements.channels])
    whole = final - stress * verdict.circuit.value("U0")
    assert verdict.budget.summed == pytest.approx(whole.tolist(), rel=0.01, abs=1e-9)
    assert parts["resistors"] is not None
    assert parts["resistors"] < 1e-9  # exact ones


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("engine", ["ngspice", "statespace"])
def test_half_the_capacitance_oscillates(engine: str) -> None:
    scene = shipped("paper-breadboard", design={"capacitance": 5e-12}, analysis={"engine": engine})
    verdict = verify(scene)
    assert verdict.outcome is Outcome.FAIL
    pole = verdict.poles.rightmost
    assert pole.real > 0
    for channel in verdict.measurements.channels:
        assert channel.state is ChannelState.OSCILLATING
        assert channel.settling_time is None
        assert channel.frequency == pytest.approx(pole.imag / (2 * math.pi), rel=2e-3)
        assert channel.growth_rate == pytest.approx(pole.real, rel=0.02)
    assert "oscillates at 37.9 kHz, growth rate +7.865 k/s" in named(verdict, "stability").reason
    assert "every channel oscillating at 37.9" in named(verdict, "steady_state").reason


def test_an_untrusted_reference_is_no_verdict() -> None:
    scene = shipped("tuned-breadboard", analysis={"engine": "statespace"})
    ideal = replace(build(scene).ideal, problem="the certificate is above its bound")
    assert verify(scene, ideal=ideal).outcome is Outcome.INCONCLUSIVE


@pytest.mark.usefixtures("ngspice")
def test_a_simulation_out_of_time() -> None:
    scene = shipped("paper-breadboard", analysis={"engine": "ngspice", "timeout": 0.01})
    with pytest.raises(TimedOut, match=r"0\.01 s"):
        verify(scene)


def test_auto_takes_the_cheapest_engine_unless_both_are_to_be_compared(ngspice: str) -> None:
    assert choose_engine(ringing_scene()) == "ngspice"
    assert choose_engine(ringing_scene(error=1e-4)) == "statespace"
    assert choose_engine(ringing_scene(error=1e-4, engine="ngspice")) == "ngspice"
    compared = make_scene(analysis={"error": 1e-4}, checks={"engines_agree": {"tolerance": 1e-3}})
    assert choose_engine(compared) == "ngspice"


def test_a_verdict_of_our_own_engine_alone_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", "/none/ngspice")
    warned = [w for w in verify(shipped("paper-breadboard")).warnings if "without ngspice" in w]
    assert "no executable '/none/ngspice'" in "".join(warned)
    asked = shipped("paper-breadboard").with_engine("statespace")
    assert not any("without ngspice" in warning for warning in verify(asked).warnings)


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
    assert verdict_document(verdict)["accuracy"]["wanted"] == 1e-4


def test_records_stay_where_repeats_fail(ngspice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The verdict is that of the first run, and says why there is no better one."""
    design = build(shipped("paper-breadboard", analysis={"engine": "ngspice"}))
    rough = replace(design.plan, wanted=1e-3 * design.plan.wanted)
    begin, plans = module.begin, list[TransientPlan]()

    def second_fails(asked: Board) -> Waiting:
        plans.append(asked.plan)
        if len(plans) > 1:
            raise StepTooSmall("the time step fell below the limit\nthe log says: ...")
        return begin(asked)

    monkeypatch.setattr(module, "begin", second_fails)
    found = observe(replace(design, plan=rough), None, Clock(lambda stage: None))
    assert len(plans) == 2
    assert found.achieved is not None
    assert found.achieved > rough.wanted
    assert (
        "the readings are of the run before it: the time step fell below the limit"
        in (found.ends.flags[-1])
    )


def test_one_engine_alone_gives_no_bound(ngspice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_answer(*_: object, **__: object) -> None:
        raise EngineError("no answer")

    monkeypatch.setattr(stepped, "simulate", no_answer)
    verdict = verify(ringing_scene(error=1e-3, engine="ngspice"))
    assert verdict.accuracy.achieved is None
    assert verdict.measurements.settling_time.uncertainty == math.inf
    assert verdict.budget.parts[-1].value is None
    checks = {check.name: check for check in verdict.checks}
    for name in ("settling_time", "engines_agree"):
        assert checks[name].outcome is Outcome.INCONCLUSIVE
    assert "no answer" in checks["engines_agree"].reason


def test_a_longer_record_is_that_of_the_band_less_the_static_error() -> None:
    design = build(ringing_scene(engine="ngspice"))
    band = design.scene.checks.settling_time.band
    short = replace(design, plan=replace(design.plan, transient=Transient(1e-12, 1e-12)))
    off = 0.9 * band * design.amplitude
    vars(short)["steady"] = SimpleNamespace(values=design.ideal.target + off)
    unsettled = SimpleNamespace(settling_time=None, amplitude=design.amplitude)
    ends = SimpleNamespace(time=[0.0, 1e-12])
    run = SimpleNamespace(board=short, measured=unsettled, ends=ends, own=object())
    plan = better_plan(cast(Run, run))
    assert plan is not None
    left = 0.5 * 0.1 * band
    assert plan.transient.stop == pytest.approx(1.2 * design.scales.stop_for(left), rel=1e-5)
    run.ends.time[-1] = 1e-13
    assert better_plan(cast(Run, run)) is None, "the board diverged: more time shows no more"


@pytest.mark.parametrize("count", [9, 20, 21, 22, 61])
def test_a_thinned_companion_keeps_both_ends(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """The last instant proves that a record is whole, whatever its number of points."""
    monkeypatch.setattr(module, "MAX_INSTANTS", 10)
    design = build(ringing_scene(engine="ngspice"))
    times = np.linspace(0.0, design.transient.stop, count)
    record = stepped.simulate(design.linear, design.transient, times=times)
    found = module.state_space_beside(design.linear, design.transient, record, 1e-6)
    assert (found.instants[0], found.instants[-1]) == (times[0], times[-1])
    assert np.all(np.diff(found.instants) > 0.0)
    assert len(found.instants) <= 21
    assert found.difference < 1e-15  # V: some BLAS kernels round each number of times otherwise
    assert 0.0 < found.doubt < 1e-9


def test_a_dip_between_the_points_of_a_record_is_a_difference() -> None:
    """The true undershoot of this board is 0.743902 % (SciPy on its deck), at 0.2 us."""
    board = Path(__file__).parents[2] / "data/straight/saturation-passes.toml"
    design = build(load_scene(board))
    ends = np.linspace(0.0, design.transient.stop, 3)
    whole = stepped.simulate(design.linear, design.transient, times=ends, resolved=True)
    u = outputs(design.circuit, whole)
    times = np.concatenate([[0.0], whole.time[whole.time > 1e-6]])
    record = stepped.simulate(design.linear, design.transient, times=times)
    found = module.state_space_beside(design.linear, design.transient, record, 1e-9)
    assert found.difference > 0.007 * np.abs(u[-1] - u[0]).max()
