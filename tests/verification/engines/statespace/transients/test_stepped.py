"""Transients of exponential and of straight amplifiers, against independent integrations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit, Output
from taction.netlist_gen.board.parts import (
    Capacitor,
    CurrentSource,
    OpAmpCell,
    Resistor,
    SignalAmplifier,
)
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats, Waveforms
from taction.system.errors import DivergesError, EngineError
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.linearised.linear_board import (
    LinearBoard,
    initial_unknowns,
)
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.step_systems import StructuredBoard
from taction.verification.engines.statespace.transients.stepped import (
    SteppedCurve,
    Task,
    halved,
    simulate,
)
from taction.verification.verdict.simulation import large_signal, on_curve, state_space_error
from tests.support import nightly
from tests.support.boards import bare, board, kernel, lone_amplifier, strain, two_pole


def breadboard(**design: float) -> Circuit:
    T, eps = kernel(7, 3.0), np.maximum(strain(7, 3.0), 0.05)
    return board(T, eps, two_pole(790e3, 12e-12), exponential=True, bias=True, **design)


def scipy_reference(
    board: LinearBoard, initial: str, times: Floats, method: str = "Radau", rtol: float = 1e-12
) -> Floats:
    """Integrate Kirchhoff's equations of a board as the state space has them, by SciPy."""
    space, devices = board.open_loop, board.descriptor.devices
    C, D = space.rows((*(board.descriptor.names[k] for k in devices.input), *board.reported(None)))
    m, sources, gain = devices.count, D[:, :2].sum(axis=1), gain_of(devices.kinds)

    def inputs(x: Floats) -> Floats:
        return np.asarray((C[:m] @ x + sources[:m]) / devices.v_scale)

    def outputs(x: Floats) -> Floats:
        return np.asarray(-devices.u_scale * gain.value(inputs(x)))

    def jacobian(_: float, x: Floats) -> Floats:
        slopes = -devices.u_scale / devices.v_scale * gain.slope(inputs(x))
        return np.asarray(space.A + (space.B[:, 2:] * slopes) @ C[:m])

    found = solve_ivp(
        lambda _, x: space.A @ x + space.B[:, :2].sum(axis=1) + space.B[:, 2:] @ outputs(x),
        (0.0, float(times[-1])),
        space.state_of(initial_unknowns(board, initial)),
        method=method,
        rtol=rtol,
        atol=1e-3 * rtol,
        jac=jacobian,
        t_eval=times,
    )
    assert found.success
    return np.array([C[m:] @ x + sources[m:] + D[m:, 2:] @ outputs(x) for x in found.y.T])


@pytest.mark.parametrize("initial", ["zero", "rest"])
def test_seven_channels_against_scipy(initial: str) -> None:
    circuit = breadboard()
    analysis = Transient(2e-5, 1e-7, initial="rest" if initial == "rest" else "zero")
    times = np.array([1e-7, 1e-6] if initial == "zero" else [1e-8, 1e-7, 1e-6])
    found = simulate(circuit, analysis, times=times)
    wanted = scipy_reference(LinearBoard(circuit), initial, times)
    assert np.abs(found.values / wanted - 1.0).max() < 1e-8
    assert found.cost.factorisations > 0


def test_steps_by_modes_are_those_by_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    one, analysis = LinearBoard(breadboard(C=47e-12)), Transient(2e-4, 1e-6)
    modal = simulate(one, analysis, tolerance=1e-6)
    assert modal.cost.factorisations == 1
    monkeypatch.setattr(stepped, "is_basis", lambda modes: False)
    solved = simulate(one, analysis, tolerance=1e-10)
    amplitude = np.abs(solved.values - solved.values[0]).max()
    assert np.abs(modal.values - solved.values).max() < 1e-6 * amplitude
    assert np.abs(halved(modal).values - solved.values).max() < 1e-8 * amplitude


def test_an_amplifier_fed_through_resistors_alone() -> None:
    # No capacitance at its input: v = (a + 3 w) / 4 + ..., algebraic in its own output.
    circuit = replace(
        lone_amplifier(),
        resistors=(
            Resistor("R", "a", "v", 3e4),
            Resistor("Rw", "w", "v", 1e4),
            Resistor("Rg", "w", "0", 1e4),
        ),
        capacitors=(Capacitor("C", "w", "0", 1e-9),),
        currents=(CurrentSource("I", "w", 1e-4),),
    )
    t = np.linspace(0.0, 1e-4, 101)
    record = simulate(circuit, Transient(1e-4, 1e-6), nodes=("v", "a", "w"), times=t)
    v, a, w = record["v"], record["a"], record["w"]
    assert a == pytest.approx(-2.0 * np.exp(v / 0.5), rel=1e-9)
    assert v == pytest.approx((a + 3.0 * w) / 4.0, abs=1e-9)
    rest = LinearBoard(circuit).equilibrium
    assert record.values[-1] == pytest.approx([rest[n] for n in ("v", "a", "w")], rel=1e-6)


@pytest.mark.parametrize("scale", [-3e8, -1e3, 1e3, 1e9])
@pytest.mark.parametrize("R", [1e4, *nightly(1e9)])
def test_any_bounded_strain_ends_or_diverges_without_overflow(scale: float, R: float) -> None:
    T, eps = kernel(3, 1.0), strain(3, 1.0)
    model = two_pole(790e3, 12e-12)
    circuit = board(T, scale * eps, model, exponential=True, bias=True, C=1e-10, R=R, Ve=0.026)
    record = simulate(circuit, Transient(1e-4, 1e-6))
    assert np.all(np.isfinite(record.values))
    assert record.cost.points < 1000  # not shortened by rounding that the growing modes share
    assert (record.time[-1] < 1e-4) == ("diverges" in " ".join(record.flags))
    if record.time[-1] < 1e-4:
        with pytest.raises(DivergesError, match="diverges") as found:
            simulate(circuit, Transient(1e-4, 1e-6), times=np.array([0.0, 5e-5, 1e-4]))
        partial = found.value.partial
        assert isinstance(partial, Waveforms)
        assert partial.time[-1] == record.time[-1]
        assert partial.values[-1] == pytest.approx(record.values[-1])


@pytest.mark.parametrize("current", ["0.3mA", *nightly("0.29mA", "0.5mA")])
def test_an_op_amp_that_rests_beyond_its_current_limit(ngspice: str, current: str) -> None:
    """Its clamp rests at 5e5 V, which is no voltage of the board; against ngspice at fine steps."""
    opamp = {"base": "ua741", "output_current": current, "level": "large-signal"}
    scene = Scene.from_arrays(
        np.ones((1, 1)), np.full(1, 8.0), capacitance=1e-10, gain=1e5, opamp=opamp, lam=0.1,
        unit_conductance="10uS", stray_capacitance=5e-12,
    )  # fmt: skip
    times = np.array([1e-5, 2e-5, 4e-5, 6e-5, 1.2e-4, 1.83e-4])
    circuit = large_signal(synthesise(scene))
    found, wanted = beside_ngspice(circuit, Transient(2e-4, 4e-9), times)
    assert found == pytest.approx(wanted, abs=1e-3)


@pytest.mark.parametrize("offset", ["-20mV", *nightly("3mV")])
def test_inputs_without_charge_jump_on_a_large_board_too(
    ngspice: str, offset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The offset is between the inputs at once; no step was found from the discharged board."""
    monkeypatch.setattr(descriptor, "LARGE", 0)
    opamp = {"base": "tl084", "offset_voltage": offset, "level": "large-signal"}
    scene = Scene.from_arrays(
        np.array([[1.0, 0.4], [0.3, -0.8]]), np.array([1.0, 0.5]), capacitance=2.2e-10,
        gain=5e5, opamp=opamp, lam=0.1, unit_conductance="2uS", stray_capacitance=2e-12,
    )  # fmt: skip
    circuit, times = large_signal(synthesise(scene)), np.array([1e-7, 1e-6, 1e-5, 1e-4, 4e-4])
    nodes = LinearBoard(circuit).reported(None)
    run = SteppedCurve.of(Task(LinearBoard(circuit), Transient(4e-4, 2e-8), nodes, None, 5e-5))
    assert isinstance(run.work.board, StructuredBoard)
    found, wanted = beside_ngspice(circuit, Transient(4e-4, 2e-8), times)
    assert np.abs(wanted).max() > 0.3
    assert found == pytest.approx(wanted, abs=2e-4)


def beside_ngspice(circuit: Circuit, analysis: Transient, times: Floats) -> tuple[Floats, Floats]:
    """Return the outputs at `times` by the engine, and by ngspice."""
    found, simulator = simulate(circuit, analysis, times=times, tolerance=5e-5), find_simulator()
    deck = write_deck(circuit, analysis, solver=simulator.solver_option)
    record = Simulation(deck, simulator, timeout=60.0).result()
    wanted = [np.interp(times, record.time, record[node]) for node in found.nodes]
    return found.values, np.stack(wanted, axis=1)


SCENES = Path(__file__).parents[5] / "scenes"
RC = 1e-5  # s
OPAMP = {"base": "ideal", "dc_gain": 1e5, "gbw": 718e3, "second_pole": 2.154e6}


def one_channel(strain: float, capacitance: float, amplifier: str = "saturation") -> LinearBoard:
    """A board of one channel, which rings."""
    scene = Scene.from_arrays(
        np.eye(1), np.array([strain]), amplifier=amplifier, exponential_slope=0.1, opamp=OPAMP,
        capacitance=capacitance, resistance=2e6, gain=1e6, unit_conductance=1e-6,
        stray_capacitance=2e-12,
    )  # fmt: skip
    return LinearBoard(synthesise(scene))


def curve_of(board: LinearBoard, stop: float) -> SteppedCurve:
    curve = simulate(board, Transient(stop, stop), times=np.array([0.0, stop])).curve
    assert isinstance(curve, SteppedCurve)
    return curve


@pytest.mark.parametrize(("name", "stop"), [("lasso", 4e-3), ("non-negative", 1e-4), ("box", 2e-3)])
def test_the_shipped_scenes_are_within_their_bound(name: str, stop: float) -> None:
    board = LinearBoard(synthesise(load_scene(SCENES / f"{name}.toml")))
    times, transient = np.linspace(0.0, stop, 51), Transient(stop, stop / 50)
    record = simulate(board, transient, times=times[[0, -1]], tolerance=1e-6, resolved=True)
    found = state_space_error(board, record)
    truth = scipy_reference(board, transient.initial, times, "LSODA", 1e-9)
    assert isinstance(record.curve, SteppedCurve)
    assert np.all(np.abs(on_curve(found.record, times) - truth) <= found.volts + 1e-8)
    assert found.volts < 1e-5


def test_an_input_that_only_touches_a_break_changes_nothing_at_once() -> None:
    """Just below and just above a grazing contact the records are alike, with and without it."""
    stop = 1e-4
    times = np.linspace(0.0, stop, 2001)

    def largest(strain: float) -> float:
        curve = curve_of(one_channel(strain, 20e-12), stop)
        return float(np.abs(curve.dense.at(times)[:, 0]).max())

    contact = brentq(lambda strain: largest(strain) - 0.1, 0.6, 0.99, xtol=1e-9)
    low, high = contact - 1e-8, contact + 1e-8
    assert largest(low) < 0.1 < largest(high)
    below, above = (curve_of(one_channel(strain, 20e-12), stop) for strain in (low, high))
    assert below.at(times) == pytest.approx(above.at(times), abs=1e-7)
    assert largest(1.01 * high) > 0.1 > largest(0.99 * low)  # volts, at which the output saturates


def period_of(late: np.ndarray, step: float) -> float:
    """Return the period by the rising crossings of the mean."""
    late = late - 0.5 * (late.max() + late.min())
    rising = np.flatnonzero((late[:-1] < 0.0) & (late[1:] >= 0.0))
    return float((rising[-1] - rising[0]) * step / (len(rising) - 1))


def test_an_unstable_board_that_saturates_has_a_limit_cycle() -> None:
    board = one_channel(0.3, 3e-12)
    assert board.state_space.modes.poles[0].real > 0.0
    times = np.linspace(0.0, 1e-4, 1001)
    curve = simulate(board, Transient(1e-4, 1e-6), times=times).curve
    assert isinstance(curve, SteppedCurve)
    truth = scipy_reference(board, "zero", times, "LSODA", 1e-6)
    late = [x[500:, 0] for x in (curve.at(times), truth)]
    assert np.ptp(late[0]) == pytest.approx(np.ptp(late[1]), rel=1e-2)
    assert period_of(late[0], times[1]) == pytest.approx(period_of(late[1], times[1]), rel=1e-2)


def own_driver(loop: float, kind: str, amps: float, farads: float = 0.0) -> LinearBoard:
    """``v = (1 - s) x + s y``, y = 10 (g(v) of 0.1 V): a loop gain of ``loop = 10 s`` at once.

    x is a capacitor that `amps` charge through a resistor, both of 1 / `RC`; `farads` delay v.
    """
    ohms, share = 1e4, 0.1 * loop
    delays = (Capacitor("Cv", "v", "0", farads),) if farads else ()
    circuit = bare(
        models={"op": OpAmp("op", 1e9)},
        amplifier=kind,
        opamps=(OpAmpCell("Xb", "op", "x", "b", "b"), OpAmpCell("Xi", "op", "0", "j", "y")),
        amplifiers=(SignalAmplifier("B", kind, "v", "m", 1.0, 0.1),),
        resistors=(
            Resistor("R", "x", "0", ohms), Resistor("R1", "m", "j", ohms),
            Resistor("R2", "j", "y", ohms), Resistor("Ra", "b", "v", ohms / (1.0 - share)),
            Resistor("Rb", "y", "v", ohms / share),
        ),
        capacitors=(Capacitor("C", "x", "0", RC / ohms), *delays),
        currents=(CurrentSource("I", "x", amps),),
        outputs=(Output("y", 1.0),),
    )  # fmt: skip
    return LinearBoard(circuit)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_board_that_would_jump_at_a_break_is_refused_in_words(sign: float) -> None:
    """Up to a loop gain of 1 there is one voltage for each state; above 1 a delay decides."""
    stop, amps = 30.0 * RC, sign * 1e-5
    x = sign * 0.1 * -np.expm1(-np.linspace(0.0, 30.0, 61))
    for loop in (0.3, 0.48):
        share = 0.1 * loop
        record = simulate(
            own_driver(loop, "saturation", amps), Transient(stop, RC),
            times=np.linspace(0.0, stop, 61),
        )  # fmt: skip
        inner = 10.0 * (1.0 - share) * x / (1.0 - loop)
        assert record.values[:, 0] == pytest.approx(np.clip(inner, -1.0, 1.0), abs=1e-6)
    jumping = own_driver(1.1, "saturation", 10.0 * amps)
    with pytest.raises(EngineError, match=r"amplifiers drive .* by a gain above 1/2: .* and jump"):
        simulate(jumping, Transient(stop, RC))
    delayed = own_driver(1.1, "saturation", 10.0 * amps, farads=1e-12)
    assert simulate(delayed, Transient(stop, RC)).values[-1] == pytest.approx([sign])
