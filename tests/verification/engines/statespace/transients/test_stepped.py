"""Transients of exponential boards, against SciPy's Radau at 1e-12 and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import Capacitor, CurrentSource, Resistor
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import DivergesError, EngineError
from taction.system.waveforms import Waveforms
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import start
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns
from taction.verification.engines.statespace.transients import integrator
from taction.verification.engines.statespace.transients.simulate import simulate
from taction.verification.engines.statespace.transients.stepped import (
    SteppedCurve,
    SteppedRun,
    Task,
    halved,
)
from taction.verification.engines.statespace.transients.structured_steps import StructuredBoard
from taction.verification.evidence.stress.catalogue import load_catalogue
from taction.verification.verdict.design import large_signal
from tests.support.boards import board, kernel, lone_amplifier, strain, two_pole


def breadboard(**design: float) -> Circuit:
    T, eps = kernel(7, 3.0), np.maximum(strain(7, 3.0), 0.05)
    return board(T, eps, two_pole(790e3, 12e-12), exponential=True, bias=True, **design)


def scipy_reference(circuit: Circuit, analysis: Transient, times: Floats) -> Floats:
    """Integrate Kirchhoff's equations of the board as the state space has them, by SciPy."""
    nodes = tuple(output.node for output in circuit.outputs)
    linear = LinearBoard(circuit)
    space, devices = linear.open_loop, linear.descriptor.devices
    rows, constant = space.C[devices.input], space.D[devices.input, :2].sum(axis=1)
    scale = -devices.u_scale

    def outputs(x: Floats) -> Floats:
        inputs = (rows @ x).T + constant
        return scale * np.exp(inputs / devices.v_scale)

    def jacobian(_: float, x: Floats) -> Floats:
        return space.A + (space.B[:, 2:] * (outputs(x) / devices.v_scale)) @ rows

    found = solve_ivp(
        lambda _, x: space.A @ x + space.B[:, :2].sum(axis=1) + space.B[:, 2:] @ outputs(x),
        (0.0, float(times[-1])),
        space.state_of(initial_unknowns(linear, analysis.initial)),
        method="Radau",
        rtol=1e-12,
        atol=1e-15,
        jac=jacobian,
        t_eval=times,
    )
    assert found.success
    order = [int(np.flatnonzero(devices.output == linear.descriptor.place(n))[0]) for n in nodes]
    return outputs(found.y)[:, order]


@pytest.mark.parametrize("initial", ["zero", "rest"])
def test_seven_channels_against_scipy(initial: str) -> None:
    circuit = breadboard()
    analysis = Transient(2e-5, 1e-7, initial="rest" if initial == "rest" else "zero")
    times = np.array([1e-7, 1e-6, 5e-6] if initial == "zero" else [1e-8, 1e-7, 1e-6])
    found = simulate(circuit, analysis, times=times)
    wanted = scipy_reference(circuit, analysis, times)
    assert np.abs(found.values / wanted - 1.0).max() < 1e-8
    assert found.cost.factorisations > 0


def test_the_transient_ends_at_the_equilibrium() -> None:
    circuit = breadboard()
    record = simulate(circuit, Transient(3e-3, 1e-6))
    rest = LinearBoard(circuit).equilibrium
    assert record.time[-1] == 3e-3
    wanted = [rest[node] for node in record.nodes]
    assert record.values[-1] == pytest.approx(wanted, rel=1e-8)


def test_from_rest_nothing_moves_without_strain() -> None:
    circuit = replace(breadboard(), currents=())
    record = simulate(circuit, Transient(1e-4, 1e-6, initial="rest"))
    assert np.abs(record.values / record.values[0] - 1.0).max() < 1e-9


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
@pytest.mark.parametrize("R", [1e4, 1e9])
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


def test_what_cannot_be_simulated_is_refused() -> None:
    with pytest.raises(EngineError, match="no amplifier kind 'cubic'"):
        simulate(lone_amplifier("cubic"), Transient(1e-4, 1e-6))
    loaded = replace(lone_amplifier(), capacitors=(Capacitor("C", "v", "a", 1e-9),))
    with pytest.raises(EngineError, match="capacitor at the output"):
        simulate(loaded, Transient(1e-4, 1e-6))
    far = Transient(1e-4, 1e-6, voltages={"v": 1e4})
    with pytest.raises(EngineError, match="beyond the range of floats in the initial state"):
        simulate(lone_amplifier(), far)


@pytest.mark.parametrize("current", ["0.29mA", "0.3mA", "0.5mA"])
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


@pytest.mark.parametrize("offset", ["-20mV", "3mV"])
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
    run = SteppedRun.of(Task(LinearBoard(circuit), Transient(4e-4, 2e-8), nodes, None, 5e-5))
    assert isinstance(run.board, StructuredBoard)
    found, wanted = beside_ngspice(circuit, Transient(4e-4, 2e-8), times)
    assert np.abs(wanted).max() > 0.3
    assert found == pytest.approx(wanted, abs=2e-4)


def test_points_of_a_board_that_diverges_follow_its_size_not_the_number_of_steps() -> None:
    """They were 111,183, then 194,939, and doubled with each halving: a run did not end."""
    case = next(case for case in load_catalogue() if case.name == "avx512-equilibrium")
    circuit = synthesise(case.scene("statespace"))
    first = simulate(circuit, Transient(3.26693e-4, 3e-7, initial="zero"), resolved=True)
    better = halved(first, resolved=True)
    assert isinstance(first.curve, SteppedCurve)
    assert isinstance(better.curve, SteppedCurve)
    assert np.abs(first.values).max() > 1e8
    assert better.curve.dense.steps == pytest.approx(2 * first.curve.dense.steps, abs=2)
    *_, before, end = better.curve.dense.ends
    assert end == pytest.approx(2.6873e-5, abs=end - before)  # of finer runs, to one step
    assert 10_000 < len(better.time) < 1.2 * len(first.time)
    # Between points the curve moves by less than 2 % of the largest voltage so far.
    middle = 0.5 * (better.time[1:] + better.time[:-1])
    away = better.curve.at(middle) - 0.5 * (better.values[1:] + better.values[:-1])
    size = np.maximum.accumulate(np.abs(better.values).max(axis=1))
    bend = np.abs(away).max(axis=1) / np.maximum(size[1:], first.curve.run.unit)
    assert 0.0 < bend.max() < 0.02


def beside_ngspice(circuit: Circuit, analysis: Transient, times: Floats) -> tuple[Floats, Floats]:
    """Return the outputs at `times` by the engine, and by ngspice."""
    found, simulator = simulate(circuit, analysis, times=times, tolerance=5e-5), find_simulator()
    deck = write_deck(circuit, analysis, solver=simulator.solver_option)
    record = start(deck, simulator, timeout=60.0).result()
    wanted = [np.interp(times, record.time, record[node]) for node in found.nodes]
    return found.values, np.stack(wanted, axis=1)


def test_a_board_without_a_solution_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integrator, "SMALLEST", 20)  # no step is allowed
    circuit = replace(breadboard(), name="seven")
    with pytest.raises(EngineError, match=r"'seven': no solution after 0.0 s: .*--engine"):
        simulate(circuit, Transient(2e-5, 1e-7))
