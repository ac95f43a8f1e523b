"""The two witnesses of a test bench: our own equations, and ngspice, alone for vendors' models."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from taction.netlist_gen.analysis import Band, Noise, OperatingPoint, SmallSignal, Transient
from taction.netlist_gen.board.circuit import VoltageSource
from taction.netlist_gen.deck.deck import Deck
from taction.system.array_types import Complexes, Floats
from taction.verification.characterise.bench import IN, OUT, Bench, VendorBench
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import simulate, start
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.output_noise import noise_intensities
from taction.verification.engines.statespace.transients.simulate import simulate as integrate

POINTS = 2000  # of a transient
TIMEOUT = 120.0  # s, of one run of ngspice
WIDE = Band(start=1e-3, steps=520, density=40)  # 1 mHz to 10 GHz: of a vendor's model


class Witness(Protocol):
    """What a witness can measure on a bench."""

    def response(self, bench: Bench, band: Band) -> Complexes:
        """Return the output voltage for an input of 1 V, at every frequency of the band, (P,)."""

    def transient(self, bench: Bench, stop: float) -> tuple[Floats, Floats]:
        """Return instants (P,), s, and output voltages (P,), V, of the bench's step."""

    def rest(self, bench: Bench) -> float:
        """Return the output voltage at rest with the input at 0 V, V."""

    def noise(self, bench: Bench, band: Band) -> float:
        """Return the mean density of the output's noise over a band, V/rtHz."""


@dataclass(frozen=True, slots=True, eq=False)
class Responses:
    """What a vendor's subcircuit shows on its bench.

    `frequencies` (P,), Hz; `gain`, `impedance` and `admittance` (P,): open-loop gain, output
    impedance, ohm, and the admittance of the inverting input, S. `output`, `inverting`, V, and
    `bias_current` into the inverting input, A, at the operating point, and the `supply_current`, A.
    """

    frequencies: Floats
    gain: Complexes
    impedance: Complexes
    admittance: Complexes
    output: float
    inverting: float
    bias_current: float
    supply_current: float


def frequencies(band: Band) -> Floats:
    """Return the frequencies of a band, Hz."""
    return np.asarray(band.start * 10.0 ** (np.arange(band.steps + 1) / band.density))


class Equations:
    """The state-space engine's equations of a bench."""

    def response(self, bench: Bench, band: Band) -> Complexes:
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

    def noise(self, bench: Bench, band: Band) -> float:
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

    def response(self, bench: Bench, band: Band) -> Complexes:
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

    def noise(self, bench: Bench, band: Band) -> float:
        """See `Witness`."""
        with start(bench.deck(Noise((band,))), self.simulator, timeout=TIMEOUT) as run:
            return run.noise() / math.sqrt(band.stop - band.start)

    def responses(self, bench: VendorBench) -> Responses:
        """Return operating point and small signals of a vendor's subcircuit."""
        point = OperatingPoint()
        rest = self._at_rest(bench.deck(point, "Vdrive drive 0 dc 0.0"))
        power = self._at_rest(bench.deck(point, "Vdrive drive 0 dc 0.0", probe="Vcc -1.0"))
        f, driven = self._respond(bench, "Vdrive drive 0 dc 0.0 ac 1.0")
        loaded = self._respond(bench, "Vdrive drive 0 dc 0.0", "Iload 0 out dc 0.0 ac 1.0")[1]
        # The servo's capacitor would bury the current of the pin in rounding.
        source = f"Vdrive inn 0 dc {float(rest[1])!r} ac 1.0"
        held = self._respond(bench, source, servo=False)[1]
        return Responses(
            frequencies=f,  # as ngspice rounded them
            gain=-driven[:, 0] / driven[:, 1],
            impedance=loaded[:, 0],
            admittance=held[:, 2] / held[:, 1],
            output=float(rest[0]),
            inverting=float(rest[1]),
            bias_current=float(rest[2]),
            supply_current=float(power[2]),
        )

    def _at_rest(self, deck: Deck) -> Floats:
        with start(deck, self.simulator, timeout=TIMEOUT) as run:
            return np.asarray(run.result().values[-1])

    def _respond(
        self, bench: VendorBench, *sources: str, servo: bool = True
    ) -> tuple[Floats, Complexes]:
        deck = bench.deck(SmallSignal(WIDE), *sources, servo=servo)
        with start(deck, self.simulator, timeout=TIMEOUT) as run:
            f, values = run.response()
        return np.asarray(f), values
