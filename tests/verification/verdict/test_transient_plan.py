"""How long a board is simulated and how finely, what a step control does, and the run's error."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.array_types import Cost, Waveforms
from taction.system.errors import DivergesError, EngineError, StepTooSmall
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.simulation import (
    StateSpaceError,
    begin,
    build,
    on_curve,
    state_space_error,
)
from taction.verification.verdict.transient_plan import (
    UNSTABLE_SECONDS,
    StepModel,
    TransientPlan,
    plan_transient,
    wanted_error,
)
from taction.verification.verdict.verify import verify
from tests.support import nightly
from tests.support.boards import (
    board,
    kernel,
    lags,
    paper_board,
    single_mode,
    strain,
    two_pole,
)
from tests.support.making import make_scene
from tests.support.paths import SCENES

SETTLING = 1.2 * math.log(1e4)  # time constants until a tenth of 1e-3 is left, and a fifth more
LOOSE = 1.5  # times the error of the first run: largest stated error
TIMES = np.concatenate([[0.0], np.geomspace(1e-9, 2e-4, 400)])
BETWEEN = TIMES[:-1] + 0.37 * np.diff(TIMES)


def planned(scene: Scene, **options: Any) -> tuple[TransientPlan, TimeScales]:
    board = LinearBoard(synthesise(scene))
    scales = time_scales(board, initial=scene.analysis.initial)
    growing = math.isfinite(scales.growth_time)
    return plan_transient(scene, board, scales, growing=growing, **options), scales


def breadboard(**values: Any) -> Scene:
    changed = {name.replace("__", "."): value for name, value in values.items()}
    return with_values(load_scene(SCENES / "paper-breadboard.toml"), changed)


def test_the_wanted_error_is_a_quarter_of_the_tightest_limit() -> None:
    checks = {"steady_state": {"tolerance": 1e-2}, "engines_agree": {"tolerance": 4e-2}}
    assert wanted_error(make_scene(checks=checks)) == pytest.approx(2.5e-3)
    band = checks | {"settling_time": {"band": 2e-3}}
    assert wanted_error(make_scene(checks=band)) == pytest.approx(5e-4)
    assert wanted_error(make_scene(checks=checks | {"overshoot": {"max": 0.0}})) == 2.5e-3
    assert wanted_error(make_scene(checks=checks | {"overshoot": {"max": 4e-4}})) == 1e-4
    assert wanted_error(make_scene(analysis={"error": 1e-7})) == 1e-7
    assert wanted_error(make_scene()) == pytest.approx(2.5e-4)


def test_the_stop_time_follows_the_slowest_mode_unless_the_scene_has_one() -> None:
    """Of the board at 1 nF and 100 kohm the signal nodes' own R and C are by far the slowest."""
    plan, scales = planned(breadboard(design__capacitance=1e-9, design__gain=1e5))
    slow = scales.amplitudes[scales.poles.real > -1e4].sum()
    longest = (SETTLING + 1.2 * math.log(max(slow, 1.0))) / -scales.poles[0].real
    assert 0.8 * longest < plan.transient.stop <= 1.01 * longest
    analysis = {"stop": 1 / 300, "initial": "rest", "points_per_period": 100}
    plan, scales = planned(make_scene(analysis=analysis))
    assert plan.transient.stop == 1 / 300
    assert plan.transient.initial == "rest"
    assert plan.transient.max_step == pytest.approx(scales.max_step_for(100), rel=1e-5)


def test_behavioural_amplifiers_cost_more_time() -> None:
    """Seven channels, as measured once: 20 us a step, and 50 us."""
    for amplifier, microseconds in (("linear", 20.0), ("exponential", 50.0)):
        plan, _ = planned(breadboard(design__amplifier=amplifier))
        assert plan.seconds / plan.steps == pytest.approx(1e-6 * microseconds, rel=0.01)


def test_an_unstable_board_gets_the_time_to_show_it_and_no_more() -> None:
    """1e-5 inside the edge of oscillation, the ringing would grow over a million of periods."""
    plan, scales = planned(breadboard(design__capacitance=5e-12))
    assert plan.growing
    assert plan.transient.stop == pytest.approx(scales.growth_time, rel=1e-5)
    assert plan.seconds <= UNSTABLE_SECONDS
    assert plan.notes == ()
    slow, scales = planned(breadboard(design__capacitance=9.0224e-12 * (1 - 1e-5)))
    assert slow.transient.stop < scales.growth_time < math.inf
    assert slow.seconds <= 1.1 * UNSTABLE_SECONDS
    (note,) = slow.notes
    assert "before the instability has grown" in note


@pytest.mark.parametrize("share", [1e-2, 1e-5])
def test_a_growing_record_of_the_exact_engine_shows_every_period(share: float) -> None:
    scene = breadboard(design__capacitance=9.0224e-12 * (1 - share))
    plan, scales = planned(scene, steps=False)
    period = scales.max_step_for(1.0)
    assert plan.growing
    assert plan.transient.max_step <= period / 8
    assert plan.transient.stop <= 20_001 * period
    assert bool(plan.notes) == (plan.transient.stop < 0.999 * scales.growth_time)


def test_the_coarse_image_of_a_large_board_does_not_decide_whether_the_outputs_grow() -> None:
    """At 2 pF the image of these 64 channels is unstable, and the board itself is stable."""
    problem = {"channels": 64, "span": 16.0, "quadrature": "rectangle"}
    design = {"capacitance": 2e-12, "gain": 5e5, "unit_conductance": 2e-6, "lambda": 0.1}
    design |= {"opamp": "tl084", "stray_capacitance": 2e-12}
    asked = make_scene(problem, design=design, analysis={"engine": "ngspice"})
    found = build(asked)
    assert not found.scales.complete
    assert found.scales.growth_time < math.inf
    assert found.poles.stable
    assert not found.plan.growing
    assert found.plan.notes == ()
    slowest = -1.0 / found.poles.rightmost.real
    assert found.transient.stop > 4.0 * slowest


@pytest.mark.parametrize("late", [False, True])
def test_where_klu_fails_at_the_start_the_older_solver_runs(
    ngspice: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late: bool
) -> None:
    """A program that gives up decks for KLU, at once or when it has their whole result."""
    program, klu = tmp_path / "ngspice", find_simulator().klu
    log = "doAnalyses: TRAN:  Timestep too small; time = 1e-9"
    program.write_text(
        f"""#!/bin/sh
        grep -qs "^.options klu" deck.cir || exec '{ngspice}' "$@"
        {f"'{ngspice}' " if late else ": "} "$@"
        echo "{log}" >&2
        exit 1
        """
    )
    program.chmod(0o755)
    monkeypatch.setenv("TACTION_NGSPICE", str(program))
    wait = begin(build(make_scene(analysis={"engine": "ngspice"})))
    if late and klu:
        with pytest.raises(StepTooSmall):
            wait()
    else:
        flags = wait().flags
        assert any("from the older solver" in flag for flag in flags) == klu


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("force", [30.0, *nightly(10.0)])
def test_steps_follow_a_board_to_a_rest_where_all_amplifiers_saturate(force: float) -> None:
    """Its modes at rest are those of the signal nodes alone; on the way there it rings."""
    scene = with_values(load_scene(SCENES / "box.toml"), {"problem.load.force": force})
    board = LinearBoard(synthesise(scene))
    scales = time_scales(board, initial=scene.analysis.initial)
    assert plan_transient(scene, board, scales).steps > 500  # by the modes at rest 70
    found = {check.name: check for check in verify(scene.with_engine("ngspice")).checks}
    assert np.abs(board.equilibrium.slopes).max() < 1e-9
    assert found["engines_agree"].outcome is Outcome.PASS


def model_of(circuit: Circuit) -> tuple[StepModel, float]:
    board = LinearBoard(circuit)
    stop = time_scales(board).stop_for(1e-5)
    return StepModel.of(board, stop), stop


def run(circuit: Circuit, transient: Transient) -> tuple[int, float]:
    """Steps of a real ngspice, and its largest error against the exact solution, of the step."""
    simulator = find_simulator()
    deck = write_deck(circuit, transient, solver=simulator.solver_option)
    found = Simulation(deck, simulator, timeout=60.0, bound=1e6).result()
    exact = exact_solution(circuit)
    off = np.abs(np.asarray(found.values) - exact.at(np.asarray(found.time))).max()
    return len(found.time), float(off / np.abs(exact.final - exact.start).max())


CHARGED = {
    "design.resistance": "182kohm",
    "design.unit_conductance": "8.264uS",
    "design.unit_voltage": "5V",
    "design.opamp.base": "opa2134",
}
"""Op-amps that hold more charge than the smallest capacitors: above the limit of the tolerance it
is relative, and ngspice takes longer steps."""
FORECASTS = [
    *((C, gain, {}, error) for error in (1e-3, 1e-5)
      for C, gain in ((1e-9, 1e5), (1e-11, 1e5), (3.3e-11, 1e6), (1e-10, 6.25e6))),
    (1e-12, 1e6, CHARGED, 1e-5),
    (1e-11, 6.252e6, {}, 1e-2),  # 320 periods of ringing, which must keep their phase
]  # fmt: skip


@pytest.mark.parametrize(("C", "gain", "design", "error"), FORECASTS)
def test_ngspice_does_what_the_forecast_says(
    ngspice: str, C: float, gain: float, design: dict[str, str], error: float
) -> None:
    """Damped and ringing boards over three decades of C and two of the gain."""
    values = {"design.capacitance": C, "design.gain": gain, **design}
    circuit = synthesise(with_values(breadboard(), values))
    model, _ = model_of(circuit)
    assert not design or np.abs(model.rest).max() > model.charge
    transient, expected, bound = model.cheapest(0.8 * error)
    steps, off = run(circuit, transient)
    assert bound <= 0.8 * error
    assert steps == pytest.approx(expected, rel=0.1, abs=60)
    assert 0.3 * error <= off <= error


@pytest.mark.parametrize("error", [1e-3, 1e-5])
@pytest.mark.parametrize("circuit", [paper_board(), single_mode(2.2e-5), lags(3, 1e-6)])
def test_a_cubic_through_instants_errs_as_little_as_asked(circuit: Circuit, error: float) -> None:
    model, stop = model_of(circuit)
    times = model.instants(error)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(stop)
    assert np.all(np.diff(times) > 0.0)
    exact = exact_solution(circuit)
    between = np.sort(np.random.default_rng(1).uniform(0.0, stop, 4000))
    cubic = CubicSpline(times, exact.at(times))(between)
    amplitude = np.abs(exact.final - exact.start).max()
    assert np.abs(cubic - exact.at(between)).max() <= 3.0 * error * amplitude
    assert len(times) < 400 + stop * np.abs(exact.poles).max() / error**0.25


@pytest.mark.parametrize("kept", [True, False])
def test_a_diverging_record_is_kept(monkeypatch: pytest.MonkeyPatch, kept: bool) -> None:
    time, values = np.array([0.0, 1e-6]), np.array([[0.0], [1e9]])
    partial = Waveforms(time, ("v_1",), values, "statespace", Cost(0.0, 2, 1)) if kept else None

    def diverging(*_: object, **__: object) -> None:
        raise DivergesError("the board diverges", partial)

    made = replace(build(make_scene()), engine="statespace")
    monkeypatch.setattr(stepped, "simulate", diverging)
    if kept:
        assert begin(made)() is partial
    else:
        with pytest.raises(DivergesError):
            begin(made)


def state_space_run(circuit: Circuit, tolerance: float) -> tuple[Waveforms, StateSpaceError]:
    made, analysis = LinearBoard(circuit), Transient(TIMES[-1], 1e-6)
    record = stepped.simulate(made, analysis, times=TIMES, tolerance=tolerance)
    return record, state_space_error(made, record)


@pytest.mark.parametrize("tolerance", [1e-5, *nightly(1e-3, 1e-7)])
def test_a_record_errs_by_less_than_stated(tolerance: float) -> None:
    """Also between its points; and the first run errs by about the stated error."""
    T, eps = kernel(40, 3.0), strain(40, 3.0)
    circuit = board(T, eps, two_pole(790e3, 12e-12), G0=0.3313e-6 * 7 / 40)
    truth = exact_solution(circuit).at
    record, stated = state_space_run(circuit, tolerance)
    assert np.abs(on_curve(stated.record, TIMES) - truth(TIMES)).max() <= stated.volts
    error = float(np.abs(record.values - truth(TIMES)).max())
    assert stated.volts <= LOOSE * error + record.rounding
    assert stated.record.curve is not None
    between = truth(BETWEEN)
    for column in range(between.shape[1]):
        found = stated.record.curve(BETWEEN, np.full(len(BETWEEN), column))
        assert np.abs(found - between[:, column]).max() <= stated.volts


def test_a_record_that_no_integrator_made_has_no_half_steps() -> None:
    record, _ = state_space_run(single_mode(2.2e-5), 1e-5)
    with pytest.raises(EngineError, match="not one of the integrator"):
        stepped.halved(record)


def test_a_step_that_is_rounding_of_its_terms_has_their_size() -> None:
    """T^T eps is 2e-16: what the modes of the differences leave in the output is no transient."""
    model = two_pole(790e3, 12e-12)
    plain = board(np.ones((2, 1)), np.array([1.0, -1.0 - 2.2e-16]), model)
    found = StepModel.of(LinearBoard(plain), 1e-4)
    assert np.abs(found.shares).max() < 10.0
