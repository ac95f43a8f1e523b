"""Test benches of one op-amp, solved by our own equations and by ngspice: what a macromodel does.

The input ``in`` is held by a voltage source, or by a switched current through `OHMS`: 1 A is 1 V.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from taction.netlist_gen.analysis import (
    Analysis,
    NoiseAnalysis,
    NoiseBand,
    OperatingPoint,
    SmallSignal,
    Transient,
)
from taction.netlist_gen.board.circuit import GROUND, NEEDED, Circuit, Output, common_facts
from taction.netlist_gen.board.parts import CurrentSource, OpAmpCell, Resistor, VoltageSource
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.deck.measures import noise_cards
from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.system.array_types import Complexes, Floats
from taction.verification.characterise.characterise import Bode, slope, supply_of
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import simulate, start
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.output_noise import noise_intensities
from taction.verification.engines.statespace.transients.simulate import simulate as integrate

IN, OUT = "in", "out"
OHMS = 1.0  # of the source of a step
TIGHT = ".options noopiter reltol=1e-7 abstol=1e-18 vntol=1e-12 chgtol=1e-21 gmin=1e-18"
POINTS = 2000  # of a transient
TIMEOUT = 120.0  # s, of one run of ngspice
_UNITS = common_facts(**dict.fromkeys(NEEDED, 1.0))
UNITS = {
    "dc_gain": "",
    "unity_gain_bandwidth": "Hz",
    "phase_margin": "degrees",
    "slew_rate": "V/s",
    "swing": "V",
    "output_current": "A",
    "offset_voltage": "V",
    "voltage_noise": "V/rtHz",
}
"""The figures that are measured, and their units."""
DENSITY = 50  # frequencies per decade
# Ends of a Bode plot: of the first pole, and of the unity-gain bandwidth.
BELOW, ABOVE = 0.01, 100.0
NOISE = NoiseBand(990.0, 1, 115)  # 990 to 1010 Hz
STEP = 0.8  # of the swing: the step of a follower that slews
RAMP = (0.2, 0.5)  # of that step: where its slope is measured
SHORT = 1e-3  # ohm: the load that takes the largest current
OVERDRIVE = 20.0  # ranges of the input stage: the input of an open loop at its limits
SETTLED = 8.0  # periods of the unity-gain bandwidth: a follower's small step
SMALL = 1e-3  # V: that step


@dataclass(frozen=True, slots=True)
class Measured:
    """One figure.

    Attributes
    ----------
    name, unit : str
        A key of `UNITS`, and its unit.
    value : float
        As measured.
    stated : float
        What the model states.
    """

    name: str
    unit: str
    value: float
    stated: float


@dataclass(frozen=True, slots=True)
class Bench:
    """One op-amp on a test bench.

    Attributes
    ----------
    opamp : OpAmp
        With the level and the errors that are to be measured.
    supply : float
        Both supply voltages, ±V.
    follower : bool
        Whether the output is the inverting input; else that is on ground: the open loop.
    step : float or None
        Voltage that switches on at t = 0, V; None for a source of 0 V, 1 V for small signals.
    load : float or None
        Resistor from the output to ground, ohm.
    """

    opamp: OpAmp
    supply: float = 15.0
    follower: bool = True
    step: float | None = None
    load: float | None = None

    @property
    def circuit(self) -> Circuit:
        """The bench for the state-space engine; a source without a step has 1 V."""
        switched = self.step is not None
        resistors = [Resistor("source", IN, GROUND, OHMS)] if switched else []
        if self.load is not None:
            resistors.append(Resistor("load", OUT, GROUND, self.load))
        return Circuit(
            name="bench",
            amplifier="linear",
            topology="bench",
            facts=_UNITS,
            models={self.opamp.name: self.opamp},
            opamps=(OpAmpCell("one", self.opamp.name, IN, OUT if self.follower else GROUND, OUT),),
            amplifiers=(),
            resistors=tuple(resistors),
            matrices=(),
            capacitors=(),
            currents=(CurrentSource("step", IN, self.step / OHMS),) if self.step else (),
            voltages=() if switched else (VoltageSource("source", IN, 1.0),),
            signal_nodes=(),
            constraint_nodes=(),
            outputs=(Output(OUT, 1.0),),
            omissions=(),
            supply=self.supply,
        )

    def deck(self, analysis: Analysis) -> Deck:
        """Return the bench as a deck for ngspice."""
        noisy = isinstance(analysis, NoiseAnalysis)
        cell = opamp_subcircuit(
            self.opamp, noninverting_grounded=False, supply=self.supply, noisy=noisy
        )
        inverting = OUT if self.follower else GROUND
        lines = ["* an op-amp on a test bench", str(cell).strip()]
        lines.append(f"Xone {IN} {inverting} {OUT} {self.opamp.name}")
        if self.step is None:
            lines.append(f"Vsource {IN} 0 0.0 ac 1.0")
        else:
            lines += [f"Istep 0 {IN} {self.step / OHMS!r}", f"Rsource {IN} 0 {OHMS!r}"]
        if self.load is not None:
            lines.append(f"Rload {OUT} 0 {self.load!r}")
        return bench_deck([*lines, TIGHT], analysis, (OUT,))


class Witness(Protocol):
    """What a witness can measure on a bench."""

    def response(self, bench: Bench, band: NoiseBand) -> Complexes:
        """Return the output voltage for an input of 1 V, at every frequency of the band, (P,)."""

    def transient(self, bench: Bench, stop: float) -> tuple[Floats, Floats]:
        """Return instants (P,), s, and output voltages (P,), V, of the bench's step."""

    def rest(self, bench: Bench) -> float:
        """Return the output voltage at rest with the input at 0 V, V."""

    def noise(self, bench: Bench, band: NoiseBand) -> float:
        """Return the mean density of the output's noise over a band, V/rtHz."""


class Equations:
    """The state-space engine's equations of a bench."""

    def response(self, bench: Bench, band: NoiseBand) -> Complexes:
        """See `Witness`."""
        descriptor = LinearBoard(bench.circuit).descriptor
        M, K = descriptor.dense.mass, descriptor.dense.stiffness
        unit = np.zeros(descriptor.size)
        unit[descriptor.place(IN)] = 1.0
        s = 2j * math.pi * frequencies(band)[:, None, None]
        z = np.linalg.solve(s * M - K, np.broadcast_to(unit[:, None], (len(s), len(unit), 1)))
        return np.asarray(z[:, descriptor.place(OUT), 0])

    def transient(self, bench: Bench, stop: float) -> tuple[Floats, Floats]:
        """See `Witness`."""
        times = np.linspace(0.0, stop, POINTS + 1)
        board = LinearBoard(bench.circuit)
        wave = integrate(board, Transient(stop, stop / POINTS), nodes=(OUT,), times=times)
        return wave.time, wave[OUT]

    def rest(self, bench: Bench) -> float:
        """See `Witness`."""
        held = replace(bench.circuit, voltages=(VoltageSource("source", IN, 0.0),))
        return float(LinearBoard(held).equilibrium[OUT])

    def noise(self, bench: Bench, band: NoiseBand) -> float:
        """See `Witness`."""
        circuit = bench.circuit
        descriptor = LinearBoard(circuit).descriptor
        M, K = descriptor.dense.mass, descriptor.dense.stiffness
        density = 2.0 * noise_intensities(circuit, descriptor)  # over positive frequencies
        f = frequencies(band)
        unit = np.zeros((descriptor.size, 1))
        unit[descriptor.place(OUT)] = 1.0
        s = 2j * math.pi * f[:, None, None]
        row = np.linalg.solve(
            np.swapaxes(s * M - K, 1, 2), np.broadcast_to(unit, (len(f), *unit.shape))
        )
        rows = row[:, :, 0]
        powers = np.einsum("pi,ij,pj->p", rows, density, rows.conj()).real
        return float(math.sqrt(np.trapezoid(powers, f) / (f[-1] - f[0])))


class Simulation:
    """ngspice on the deck of a bench."""

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator

    def response(self, bench: Bench, band: NoiseBand) -> Complexes:
        """See `Witness`."""
        with start(bench.deck(SmallSignal(band)), self.simulator, timeout=TIMEOUT) as run:
            return run.response()[1][:, 0]

    def transient(self, bench: Bench, stop: float) -> tuple[Floats, Floats]:
        """See `Witness`."""
        deck = bench.deck(Transient(stop, stop / POINTS))
        wave = simulate(deck, self.simulator, timeout=TIMEOUT)
        return wave.time, wave[OUT]

    def rest(self, bench: Bench) -> float:
        """See `Witness`."""
        wave = simulate(bench.deck(OperatingPoint()), self.simulator, timeout=TIMEOUT)
        return float(wave[OUT][-1])

    def noise(self, bench: Bench, band: NoiseBand) -> float:
        """See `Witness`."""
        with start(bench.deck(NoiseAnalysis((band,))), self.simulator, timeout=TIMEOUT) as run:
            return run.noise() / math.sqrt(band.stop - band.start)


def bode(opamp: OpAmp, witness: Witness) -> Bode:
    """Return the open-loop gain from far below the first pole to far above unity gain."""
    finite = math.isfinite(opamp.gbw)
    low, high = (opamp.first_pole, unity_gain_bandwidth(opamp)) if finite else (1.0, 1e6)
    decades = math.log10(ABOVE * high / (BELOW * low))
    band = NoiseBand(BELOW * low, math.ceil(decades * DENSITY), DENSITY)
    bench = Bench(_linear(opamp), follower=False)
    return Bode(frequencies(band), witness.response(bench, band))


def characterise(opamp: OpAmp, witness: Witness) -> tuple[Measured, ...]:
    """Measure the figures of an op-amp that its macromodel has.

    Small signals are measured on the open loop, the slew rate, the offset and the noise on a
    follower. The supply is the largest that the part allows, ±15 V at most.

    Raises
    ------
    SimulationError, EngineError
        A run gave no result.

    """
    opened = bode(opamp, witness)
    found = {"dc_gain": (float(abs(opened.response[0])), opamp.dc_gain)}
    if math.isfinite(opamp.gbw):
        crossing = opened.crossing()
        found["unity_gain_bandwidth"] = (crossing[0], unity_gain_bandwidth(opamp))
        found["phase_margin"] = (crossing[1], phase_margin(opamp))
    if math.isfinite(opamp.input_range):
        found |= _limits(opamp, witness)
    if opamp.offset_voltage:
        only = replace(_linear(opamp), input_errors=True, bias_current=0.0, offset_current=0.0)
        found["offset_voltage"] = (witness.rest(Bench(only)), opamp.offset_voltage)
    if opamp.voltage_noise:
        quiet = replace(_linear(opamp), current_noise=0.0, voltage_noise_corner=None)
        density = witness.noise(Bench(quiet), NOISE)
        found["voltage_noise"] = (density, opamp.voltage_noise)
    return tuple(Measured(name, UNITS[name], *found[name]) for name in UNITS if name in found)


def _limits(opamp: OpAmp, witness: Witness) -> dict[str, tuple[float, float]]:
    """Measure slew rate, swing and largest output current; pairs of measured and stated."""
    supply = supply_of(opamp)
    limited, swing = replace(_linear(opamp), large_signal=True), opamp.swing(supply)
    rise, step = _rise(opamp), STEP * swing
    time, volts = large_step(opamp, witness)
    rate = slope(time, volts, RAMP[0] * step, RAMP[1] * step)
    found = {"slew_rate": (rate, opamp.slew_rate)}
    driven = Bench(limited, supply, follower=False, step=OVERDRIVE * opamp.input_range)
    found["swing"] = (float(witness.transient(driven, 2.0 * rise)[1][-1]), swing)
    if opamp.has_largest_current:
        shorted = replace(driven, opamp=replace(limited, limits_current=True), load=SHORT)
        amps = float(witness.transient(shorted, 2.0 * rise)[1][-1]) / SHORT
        found["output_current"] = (amps, opamp.output_current)
    return found


def large_step(opamp: OpAmp, witness: Witness) -> tuple[Floats, Floats]:
    """Return instants, s, and the output, V, of a follower with a step of `STEP` of the swing."""
    supply = supply_of(opamp)
    limited = replace(_linear(opamp), large_signal=True)
    return witness.transient(Bench(limited, supply, step=STEP * opamp.swing(supply)), _rise(opamp))


def _rise(opamp: OpAmp) -> float:
    """Return a time in which an output rises to its swing, s."""
    return 2.0 * opamp.swing(supply_of(opamp)) / opamp.slew_rate + SETTLED / opamp.gbw


def step_response(opamp: OpAmp, witness: Witness) -> tuple[Floats, Floats]:
    """Return instants, s, and the response of a follower to a small step, as parts of the step."""
    stop = SETTLED / unity_gain_bandwidth(opamp) if math.isfinite(opamp.gbw) else 1e-6
    time, volts = witness.transient(Bench(_linear(opamp), step=SMALL), stop)
    return time, volts / SMALL


def _linear(opamp: OpAmp) -> OpAmp:
    return replace(opamp.small_signal, input_errors=False)


def bench_deck(lines: list[str], analysis: Analysis, saved: tuple[str, ...]) -> Deck:
    """Return a deck with the cards of its analysis."""
    save = ".save " + " ".join(f"v({node})" for node in saved)
    cards = [save, ".op"]
    if isinstance(analysis, NoiseAnalysis):
        cards = noise_cards(analysis, OUT)
    elif isinstance(analysis, SmallSignal):
        band = analysis.band
        stop = band.stop * (1.0 + 1e-9)  # rounding could leave out the last frequency
        cards = [save, f".ac dec {band.density} {band.start!r} {stop!r}"]
    elif isinstance(analysis, Transient):
        step = repr(analysis.max_step)
        start = " uic" if analysis.initial == "zero" else ""
        cards = [save, f".tran {step} {analysis.stop!r} 0.0 {step}{start}"]
    return Deck("\n".join([*lines, *cards, ".end", ""]), saved, analysis)


def frequencies(band: NoiseBand) -> Floats:
    """Return the frequencies of a band, Hz."""
    return np.asarray(band.start * 10.0 ** (np.arange(band.steps + 1) / band.density))
