"""Boards made by hand for the tests of the state-space engine, and drawn large ones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Output, Role, common_facts, common_knobs
from taction.netlist_gen.board.parts import (
    Capacitor,
    CurrentSource,
    OpAmpCell,
    Resistor,
    SignalAmplifier,
    VoltageSource,
)
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import draw, parameters, vary
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.find_modes import find_modes
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.linearised.reduction import (
    Pencil,
    reduce_pencil,
)

IDEAL = OpAmp("ideal", 1e8)


def two_pole(
    gbw: float, cin: float, *, gain: float = 1e5, output: float = 75.0, rin: float = np.inf
) -> OpAmp:
    """Second pole at three times the gain-bandwidth product."""
    return OpAmp(
        "two_pole",
        gain,
        gbw=gbw,
        second_pole=3.0 * gbw,
        input_resistance=rin,
        input_capacitance=cin,
        output_resistance=output,
    )


def kernel(channels: int, span: float, depth: float = 1.0) -> Floats:
    """Eq (19) with E = 1 at equally spaced points."""
    y = np.linspace(-span, span, channels)
    d2 = (y[:, None] - y[None, :]) ** 2
    x2 = depth**2
    return 3.0 / (2.0 * np.pi) * depth * (x2 - d2) / (x2 + d2) ** 2


def strain(channels: int, span: float) -> Floats:
    """Strain of the cylinder load (18) with p = 3, a = 1, finely integrated."""
    y = np.linspace(-span, span, channels)
    s = np.linspace(-1.0, 1.0, 4001)[1:-1]
    d2 = (y[:, None] - s[None, :]) ** 2
    profile = 3.0 / np.pi * np.sqrt(1.0 - s**2)
    response = 3.0 / (2.0 * np.pi) * (1.0 - d2) / (1.0 + d2) ** 2
    total: Floats = (response * profile).sum(axis=1) * (s[1] - s[0])
    return total


def board(
    T: Floats,
    eps: Floats,
    model: OpAmp,
    *,
    R: float = 1.786e6,
    C: float = 10e-12,
    s: float = 6.252e6,
    G0: float = 0.3313e-6,
    exponential: bool = False,
    bias: bool = False,
    U0: float = 1.0,
    Ve: float = 1.0,
) -> Circuit:
    """Integrator topology, with one op-amp type and without strays; inverters have 100 kohm."""
    scene = Scene.from_arrays(
        T,
        eps,
        amplifier="exponential" if exponential else "linear",
        resistance=R,
        capacitance=C,
        gain=s,
        unit_conductance=G0,
        unit_voltage=U0,
        opamp="ideal",
        stray_capacitance=0,
        inverter_resistance=1e5,
        **({"exponential_slope": Ve, "bias": bias} if exponential else {}),
    )
    made = synthesise(scene)
    cells = tuple(replace(cell, model=model.name) for cell in made.opamps)
    return replace(made, models={model.name: model}, opamps=cells)


def paper_board(C: float = 10e-12, gbw: float = 790e3, cin: float = 12.1e-12) -> Circuit:
    """Row A of the calibration: seven channels over [-3, 3]."""
    return board(kernel(7, 3.0), strain(7, 3.0), two_pole(gbw, cin), C=C)


def single_mode(rc: float, tau: float = 0.455e-6, gain: float = 100.0) -> Circuit:
    """One mode with DC loop gain K and two equal lags: ``(1 + p RC)(1 + p tau)^2 + K = 0``.

    Built of ideal op-amps: a leaky integrator, then two lags of a resistor and a capacitor each,
    buffered; the last amplifier has gain K.
    """
    R, G = 10e3, 1e-4
    buffers = [OpAmpCell(f"Xb{k}", "follow", f"l{k}", f"b{k}", f"b{k}") for k in (1, 2)]
    return Circuit(
        name="single",
        amplifier="linear",
        topology="integrator",
        facts=common_facts(G0=G, U0=1.0, R=R, C=rc / R, gain=R, **{"lambda": 1.0}),
        models={"follow": OpAmp("follow", 1e9)},
        opamps=(OpAmpCell("Xv", "follow", "0", "x", "v"), *buffers),
        resistors=(
            Resistor("R", "x", "v", R),
            Resistor("R1", "v", "l1", R),
            Resistor("R2", "b1", "l2", R),
            Resistor("Rk", "b2", "x", R / gain),
        ),
        capacitors=(
            Capacitor("C", "x", "v", rc / R),
            Capacitor("C1", "l1", "0", tau / R),
            Capacitor("C2", "l2", "0", tau / R),
        ),
        currents=(CurrentSource("I", "x", -1e-4),),
        signal_nodes=("v",),
        constraint_nodes=("b2",),
        outputs=(Output("v", 1.0),),
        roles={Role.SIGNAL_CAPACITOR: frozenset(("CC",))},
        knobs=common_knobs(linear=True),
    )


def bare(**parts: Any) -> Circuit:
    """A board of the given parts alone."""
    kinds = ("opamps", "amplifiers", "resistors", "matrices", "capacitors", "currents", "voltages")
    none: dict[str, Any] = dict.fromkeys((*kinds, "outputs"), ())
    return replace(single_mode(1e-6), **none | {"models": {}} | parts)


def lone_amplifier(kind: str = "exponential") -> Circuit:
    """``R C v' = -v - U0 exp(v / Ve)``: a capacitor that its own exponential charges."""
    return bare(
        amplifier=kind,
        amplifiers=(SignalAmplifier("B", kind, "v", "a", 2.0, 0.5),),
        resistors=(Resistor("R", "a", "v", 1e4), Resistor("Rv", "v", "0", 1e15)),
        capacitors=(Capacitor("C", "v", "0", 1e-9),),
        outputs=(Output("a", -1.0),),
    )


def lag_board(ratio: float, gain: float) -> Circuit:
    """``(1 + p RC)(1 + p tau)^2 + gain = 0`` with ``RC = ratio tau``, of op-amps with gain 1e15."""
    tau = 0.455e-6
    made = single_mode(ratio * tau, tau, gain)
    return replace(made, models={"follow": OpAmp("follow", 1e15)})


def window(gain: float) -> tuple[float, float]:
    """Both ends of the unstable window in ``RC / tau``: ``2 a² + (4 - K) a + 2 = 0`` (Routh)."""
    root = math.sqrt((gain - 4.0) ** 2 - 16.0)
    return (gain - 4.0 - root) / 4.0, (gain - 4.0 + root) / 4.0


def lags(count: int, tau: float) -> Circuit:
    """Buffered RC stages of one time constant after a 1 V source: a Jordan block of that size."""
    places = range(1, count + 1)
    ends = ["in", *(f"b{k}" for k in places)]
    return bare(
        models={"op": OpAmp("op", 1e15)},
        opamps=tuple(
            OpAmpCell(f"X{k}", "op", f"c{k}", f"b{k}", f"b{k}") for k in range(1, count + 1)
        ),
        resistors=tuple(Resistor(f"R{k}", ends[k - 1], f"c{k}", 1e3) for k in places),
        capacitors=tuple(Capacitor(f"C{k}", f"c{k}", "0", tau / 1e3) for k in places),
        voltages=(VoltageSource("V", "in", 1.0),),
        outputs=(Output(f"b{count}", 1.0),),
    )


def drawn_board(seed: int, channels: int = 24, **design: object) -> Circuit:
    """A board with a drawn matrix of drawn shape, op-amp and capacitance; every part has a load."""
    rng = np.random.default_rng(seed)
    sensors = channels + int(rng.integers(-4, 5))
    T = rng.uniform(-1.0, 1.0, (sensors, channels)) * (2.0 / np.sqrt(channels))
    T[rng.uniform(size=T.shape) < 0.3] = 0.0
    asked = {
        "opamp": {"base": str(rng.choice(["tl084", "op27"])), "input_errors": "none"},
        "capacitance": float(rng.choice([1e-9, 2e-10])),
        "gain": float(rng.choice([1e5, 1e6])),
        "lam": 0.1,
        "unit_conductance": "2uS",
        "stray_capacitance": "2pF",
    } | design
    return synthesise(Scene.from_arrays(T, T @ rng.uniform(-1.0, 1.0, channels), **asked))


def decompose(A: np.ndarray) -> Modes:
    """Return the modes of ``x' = A x``, A in 1/s."""
    one = np.eye(len(A))
    parts = one, A, np.zeros((len(A), 1)), one, np.abs(A)
    return find_modes(reduce_pencil(Pencil(*parts), []))


def outputs_at_rest(circuit: Circuit) -> Floats:
    """Return the outputs of a board at rest, V, with their signs."""
    rest = LinearBoard(circuit).equilibrium
    return np.array([output.sign * rest[output.node] for output in circuit.outputs])


def sampled(circuit: Circuit, count: int, tolerances: Tolerances) -> Floats:
    """Outputs at rest, V, (count, N), of boards whose parts are drawn one by one."""
    varied = parameters(circuit, tolerances)
    drawn = (draw(tolerances, varied, 40, k) for k in range(count))
    return np.array([outputs_at_rest(vary(circuit, tolerances, z)) for z in drawn])
