"""What ngspice does with a step control, against what its forecast says beforehand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import Simulation
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.verdict.transient_plan import StepForecast, StepModel
from tests.support.boards import lags, paper_board, single_mode
from tests.support.paths import SCENES


def breadboard(C: float, gain: float) -> Circuit:
    values = {"design.capacitance": C, "design.gain": gain}
    return synthesise(with_values(load_scene(SCENES / "paper-breadboard.toml"), values))


def model_of(circuit: Circuit) -> tuple[StepModel, float]:
    board = LinearBoard(circuit)
    stop = time_scales(board).stop_for(1e-5)
    return StepModel.of(board, stop), stop


def run(circuit: Circuit, stop: float, forecast: StepForecast) -> tuple[int, float]:
    """Steps of a real ngspice, and its largest error against the exact solution, of the step."""
    analysis = Transient(
        stop,
        forecast.max_step,
        forecast.truncation,
        charge=forecast.charge,
        first_step=forecast.first_step,
    )
    simulator = find_simulator()
    deck = write_deck(circuit, analysis, solver=simulator.solver_option)
    found = Simulation(deck, simulator, timeout=60.0, bound=1e6).result()
    exact = exact_solution(circuit)
    off = np.abs(np.asarray(found.values) - exact.at(np.asarray(found.time))).max()
    return len(found.time), float(off / np.abs(exact.final - exact.start).max())


@pytest.mark.parametrize("error", [1e-3, 1e-5])
@pytest.mark.parametrize(
    ("C", "gain"), [(1e-9, 1e5), (1e-11, 1e5), (3.3e-11, 1e6), (1e-10, 6.25e6)]
)
def test_ngspice_does_what_the_forecast_says(
    ngspice: str, C: float, gain: float, error: float
) -> None:
    """Damped and ringing boards over two decades of C and gain."""
    circuit = breadboard(C, gain)
    model, stop = model_of(circuit)
    forecast = model.cheapest(0.8 * error)
    steps, off = run(circuit, stop, forecast)
    assert forecast.error <= 0.8 * error
    assert steps == pytest.approx(forecast.steps, rel=0.1, abs=60)
    assert off <= error
    assert off >= 0.3 * error


@pytest.mark.parametrize("gain", ["1Mohm", "5Mohm"])
def test_op_amps_hold_more_charge_than_small_capacitors(ngspice: str, gain: str) -> None:
    """A charge above the limit has a relative tolerance: ngspice then takes longer steps."""
    values = {
        "design.capacitance": "1pF",
        "design.gain": gain,
        "design.resistance": "182kohm",
        "design.unit_conductance": "8.264uS",
        "design.unit_voltage": "5V",
        "design.opamp.base": "opa2134",
    }
    circuit = synthesise(with_values(load_scene(SCENES / "paper-breadboard.toml"), values))
    (model, stop), error = model_of(circuit), 1e-5
    assert np.abs(model.rest).max() > model.charge
    forecast = model.cheapest(0.8 * error)
    steps, off = run(circuit, stop, forecast)
    assert steps == pytest.approx(forecast.steps, rel=0.1, abs=20)
    assert 0.3 * error <= off <= error


def test_the_steps_of_an_edge_of_oscillation(ngspice: str) -> None:
    """320 periods of ringing, which must keep their phase."""
    model, stop = model_of(breadboard(1e-11, 6.252e6))
    forecast = model.cheapest(8e-3)
    steps, off = run(breadboard(1e-11, 6.252e6), stop, forecast)
    assert steps == pytest.approx(forecast.steps, rel=0.1)
    assert 3e-3 < off <= 1e-2


@pytest.mark.parametrize("points", [16.0, 40.0, 125.0])
def test_even_steps_err_as_the_trapezoidal_rule_does(points: float) -> None:
    """The rule itself, carried out on the modes of the board."""
    circuit = paper_board(C=3e-11)
    model, stop = model_of(circuit)
    step = time_scales(circuit).max_step_for(points)
    forecast = model.even(step)
    exact = exact_solution(circuit)
    k = np.arange(int(stop / step))
    p = exact.flow.poles
    rule = ((1 + p * step / 2) / (1 - p * step / 2)) ** k[:, None] - np.exp(p * step * k[:, None])
    off = np.abs((rule @ exact.flow.share).real).max() / np.abs(exact.final - exact.start).max()
    assert forecast.error == pytest.approx(off, rel=0.1)
    assert forecast.steps == pytest.approx(stop / step, rel=0.05)


@pytest.mark.parametrize("error", [1e-3, 1e-5])
@pytest.mark.parametrize("circuit", [paper_board(), single_mode(2.2e-5), lags(3, 1e-6)])
def test_a_cubic_through_the_instants_of_a_record_errs_as_little_as_asked(
    circuit: Circuit, error: float
) -> None:
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


def test_a_large_board_is_forecast_by_its_coarse_image() -> None:
    values = {
        "problem.channels": 64,
        "problem.quadrature": "rectangle",
        "design.lambda": 0.1,
    }
    board = LinearBoard(
        synthesise(with_values(load_scene(SCENES / "tuned-breadboard.toml"), values))
    )
    assert board.descriptor.is_large
    forecast = StepModel.of(board, 1e-4).cheapest(1e-3)
    assert forecast.error <= 1e-3
    assert math.isfinite(forecast.steps)
