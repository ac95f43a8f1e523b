"""DC equilibria: the regularised optimum, op-amps beyond a limit, sensitivities, refusals."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.netlist_gen.board.circuit import Output
from taction.netlist_gen.board.parts import CurrentSource, OpAmpCell, Resistor
from taction.netlist_gen.scene.open_tables import AMPLIFIERS, OPAMPS
from taction.spice_models.opamp import KNEE, OpAmp
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS, gain_of
from taction.verification.engines.statespace.equations.stamps import stamp
from taction.verification.engines.statespace.linearised.equilibrium import solve_loop
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.verdict.verify import Verdict, verify
from tests.support.boards import (
    IDEAL,
    bare,
    board,
    kernel,
    paper_board,
    single_mode,
    strain,
    two_pole,
)
from tests.support.making import make_scene


def test_the_single_mode_divides_by_its_loop_gain() -> None:
    found = LinearBoard(single_mode(1e-6)).equilibrium
    # 1e-4 A out of x through 1 / (1/R + K/R) with R = 10 k.
    assert found["v"] == pytest.approx(1.0 / 101.0, rel=1e-6)
    assert found["0"] == 0.0
    assert found.residual < 1e-14
    assert LinearBoard(single_mode(1e-6)).rest["v"] == 0.0


def entropy_gradient(u: np.ndarray, T: np.ndarray, eps: np.ndarray, lam: float) -> np.ndarray:
    return np.asarray(2.0 * T.T @ (T @ u - eps) + lam * (np.log(u) + 1.0))


@pytest.mark.parametrize("s", [1e3, 1e6, 1e9])
def test_an_ideal_exponential_board_rests_at_the_entropy_optimum(s: float) -> None:
    T, eps = kernel(7, 3.0), np.maximum(strain(7, 3.0), 0.05)
    circuit = board(T, eps, IDEAL, s=s, exponential=True, bias=True)
    found = LinearBoard(circuit).equilibrium
    u = np.array([output.sign * found[output.node] for output in circuit.outputs])
    assert np.all(u > 0.0)
    gradient = entropy_gradient(u, T, eps, circuit.value("lambda"))
    scale = np.abs(2.0 * T.T @ eps).max() + circuit.value("lambda")
    assert np.abs(gradient).max() < 1e-4 * scale


@given(seed=st.integers(0, 2**16), strength=st.floats(-8.0, 12.0), drive=st.floats(-3.0, 3.0))
def test_monotone_exponential_loops_are_solved(seed: int, strength: float, drive: float) -> None:
    rng = np.random.default_rng(seed)
    B = rng.standard_normal((6, 8))
    H = 10.0**strength * B @ B.T
    H += 1e-5 * np.abs(H).max() * rng.standard_normal((6, 6))
    a = 10.0**drive * rng.standard_normal(6)
    y = solve_loop(H, a, gain_of(("exponential",)))
    terms = np.abs(y) + np.abs(H) @ np.exp(y) + np.abs(a)
    assert np.all(np.abs(y + H @ np.exp(y) - a) <= 1e-10 * terms)


def test_a_loop_with_positive_feedback_and_no_solution_is_refused() -> None:
    with pytest.raises(EngineError, match="no equilibrium found"):
        solve_loop(np.array([[-1.0]]), np.array([2.0]), gain_of(("exponential",)))


def test_a_node_without_a_path_is_named() -> None:
    circuit = paper_board()
    floating = replace(circuit, resistors=(*circuit.resistors, Resistor("Rx", "p", "q", 1.0)))
    with pytest.raises(EngineError, match=r"node '[pq]'"):
        _ = LinearBoard(floating).equilibrium


@pytest.mark.parametrize("kind", sorted(GAINS))
def test_coordinates_invert_and_slopes_are_slopes(kind: str) -> None:
    gain = GAINS[kind]
    q, h = (a.ravel() for a in np.meshgrid(np.linspace(-50, 500, 23), 10.0 ** np.arange(-12, 13)))
    q, h = np.append(q, [-1e9, 1e9]), np.append(h, [0.06, 0.06])
    y = gain.from_coordinate(q, h)
    rest = np.abs(y + h * gain.value(y) - q)
    ulp = np.finfo(float).eps * np.abs(y)  # y has no value nearer to a break than this
    assert np.all(rest <= 1e-13 * (1.0 + np.abs(q)) * (1.0 + np.abs(y)) + h * gain.slope(y) * ulp)
    x, d = np.linspace(-2.0, 2.0, 9), 1e-5
    x = np.setdiff1d(x, gain.breaks or ())
    assert (gain.value(x + d) - gain.value(x - d)) / (2 * d) == pytest.approx(gain.slope(x), 1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_a_channel_without_strain_has_a_certificate_with_any_rounding(seed: int) -> None:
    # Channel 1 sees nothing: whatever its unknowns are but 0 is rounding.
    T, eps = np.array([[0.0, 1.0], [0.0, 0.5]]), np.array([1.0, 0.4])
    circuit = board(T, eps, two_pole(1e5, 1e-11), exponential=True, bias=False)
    descriptor = stamp(circuit)
    draw = np.random.default_rng(seed)
    nudge = 1e-30 * draw.standard_normal(descriptor.size)
    nudged = replace(descriptor, switched=descriptor.switched + nudge)
    rest, plain = LinearBoard(circuit, nudged).equilibrium, LinearBoard(circuit).equilibrium
    assert rest.residual < 1e-12
    assert rest.values == pytest.approx(plain.values, rel=1e-12, abs=1e-20)


def test_the_rounding_of_an_equilibrium_covers_what_other_roundings_give() -> None:
    linear = LinearBoard(paper_board(7e-12))
    descriptor, rest = linear.descriptor, linear.equilibrium
    for seed in range(5):
        draw = np.random.default_rng(seed).standard_normal(len(descriptor.local.values))
        local = descriptor.local._replace(values=descriptor.local.values * (1 + 2e-16 * draw))
        nudged = replace(descriptor, local=local)
        moved = LinearBoard(linear.circuit, nudged).equilibrium.values - rest.values
        assert np.all(np.abs(moved) <= 4.0 * linear.rounding.max())


T = np.array([[1.0, -0.3, 0.05], [0.2, 0.8, 0.1], [0.0, 0.25, 1.1], [0.4, -0.1, 0.3]])
LAM, U0 = 0.2, 0.5


LIMITED = replace(OPAMPS["ua741"], large_signal=True)


def open_loop(opamp: OpAmp, drive: float, load: float = 1e15) -> float:
    """Return where an op-amp at ±15 V rests without feedback, V, driven by `drive` V."""
    circuit = bare(
        models={"op": opamp},
        opamps=(OpAmpCell("one", "op", "in", "0", "out"),),
        resistors=(Resistor("source", "in", "0", 1.0), Resistor("load", "out", "0", load)),
        currents=(CurrentSource("step", "in", drive),),
        outputs=(Output("out", 1.0),),
    )
    return LinearBoard(replace(circuit, supply=15.0)).equilibrium["out"]


@pytest.mark.parametrize("drive", [-2.0, -0.05, 0.05, 0.3])
def test_an_open_loop_rests_at_its_swing(drive: float) -> None:
    # the clamp draws what the input stage gives: tanh((x - 14)/d) + tanh((x + 14)/d) = tanh(v/V)
    drawn = math.tanh(abs(drive) / LIMITED.input_range)
    expected = 14.0 + 14.0 / KNEE * math.atanh(drawn - 1.0)
    rest = open_loop(LIMITED, drive)
    assert rest == pytest.approx(math.copysign(expected, drive), rel=1e-4)


def test_a_short_circuit_takes_the_largest_current() -> None:
    # 14 V at the first pole, 75 ohm, and a drop of 15 V softplus(100 (i / 25 mA - 1))
    opamp = replace(LIMITED, limits_current=True)
    amps = open_loop(opamp, 1.0, 1e-3) / 1e-3
    beyond = math.log(math.expm1((14.0 - 75.0 * amps) / 15.0)) / 100.0
    assert amps == pytest.approx(25e-3 * (1.0 + beyond), rel=1e-5)


NONLINEAR = [name for name in AMPLIFIERS if name != "linear"]
"""g itself where it has no inverse."""
BOARD = {
    "capacitance": "100pF",
    "resistance": "2Mohm",
    "gain": "1Mohm",
    "unit_conductance": "1uS",
    "exponential_slope": "300mV",
    "unit_voltage": "500mV",
    "stray_capacitance": "1pF",
    "opamp": {"base": "ideal", "dc_gain": 1e6, "gbw": "10MHz", "second_pole": "30MHz"},
}


def scene(amplifier: str, bias: bool):
    force = {"deadzone": 15.0, "rectifier": 15.0, "saturation": 6.0}.get(amplifier, 1.5)
    problem = {"kind": "tactile", "channels": 3, "span": 1.5, "load": {"force": force}}
    return make_scene(problem=problem, design=BOARD | {"amplifier": amplifier, "bias": bias})


@functools.cache
def verdict_of(amplifier: str, bias: bool) -> Verdict:
    return verify(scene(amplifier, bias))


@pytest.mark.parametrize("bias", [False, True])
@pytest.mark.parametrize("amplifier", NONLINEAR)
def test_ngspice_the_state_space_and_the_reference_agree(ngspice: str, amplifier: str, bias: bool):
    verdict = verdict_of(amplifier, bias)
    assert verdict.waveforms.engine.startswith("ngspice")
    assert {c.name: c.outcome.value for c in verdict.checks} == {
        "steady_state": "pass",
        "settling_time": "pass",
        "stability": "pass",
        "engines_agree": "pass",
    }
