"""The noise of the outputs at rest, where a scene has a limit for it.

It is integrated in bands of frequencies, in which the analysis follows every resonance of a board.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.analysis import NoiseAnalysis, NoiseBand
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.check_keys import LOWEST
from taction.system.array_types import Complexes
from taction.system.errors import EngineError, SimulationError
from taction.system.quantities import show
from taction.verification.engines.ngspice.evidence import integrated_noise
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.verdict.board import Board

STEP = 0.1  # of the distance to the nearest pole: step of the frequencies
BELOW, ABOVE = 1e-4, 1e4  # of the slowest, and of the fastest pole: first and last frequency
COARSEST = 20  # steps per decade; finer bands have this times a power of 2
MOST_STEPS = 20_000


def noise_bands(poles: Complexes, lowest: float = 0.0) -> tuple[NoiseBand, ...]:
    """Return bands for the integral of a spectrum with these poles, 1/s, above `lowest`, Hz.

    A spectrum changes over the distance from ``j 2 pi f`` to the nearest pole. With the defaults
    Simpson's rule errs by less than 1e-3 of the integral, and so does what lies outside the bands.
    """
    sizes = np.abs(poles) / math.tau
    f, last = lowest or BELOW * float(sizes.min()), ABOVE * max(float(sizes.max()), lowest)
    bands, left = list[NoiseBand](), MOST_STEPS
    while f < last:
        density, steps, start = _density(f, poles), 0, f
        ratio = 10.0 ** (1.0 / density)
        while f < last and (steps == 0 or _density(f, poles) == density):
            f, steps, left = f * ratio, steps + 1, left - 1
            if left < 0 or ratio == 1.0:
                raise EngineError(f"the resonances need more than {MOST_STEPS} frequencies")
        band = NoiseBand(start, steps, density)
        bands.append(band)
        f = band.stop
    return tuple(bands)


def _density(f: float, poles: Complexes) -> int:
    """Return the steps per decade at a frequency, Hz."""
    distance = float(np.abs(1j * math.tau * f - poles).min())
    wanted = math.tau * f * math.log(10.0) / (STEP * distance)
    doublings = max(math.ceil(math.log2(wanted / COARSEST)), 0)
    return int(COARSEST * 2**doublings)


UNSTATED = (
    "the voltage noise of op-amp {} is not given: set design.opamp.voltage_noise, such as"
    " '20nV/rtHz', or take a preset that has one (taction parts)"
)
NO_CORNER = "1/f noise of op-amp {} not known (design.opamp.voltage_noise_corner), so left out"
UNSTABLE = "an unstable board has no noise at rest"


@dataclass(frozen=True, slots=True)
class OutputNoise:
    """Noise of every channel, from the state-space engine."""

    DOCUMENT = (
        *("rms", "uncertainties = error", "unit", "ngspice = simulated"),
        *("reason = unknown", "lowest [Hz]"),
    )

    rms: tuple[float, ...] = ()  # of each channel, V; empty where they are not known
    error: tuple[float, ...] = ()  # bounds on the errors, V
    unknown: str = ""  # why they are not known, or empty
    # Noise of the channel with the largest one from ngspice, V; None without ngspice.
    simulated: float | None = None
    lacking: str = ""  # of which op-amps with poles the voltage noise is not given, or empty
    notes: tuple[str, ...] = ()  # what else op-amps leave out
    lowest: float = 0.0  # the lowest frequency that counts, Hz
    flickers: bool = False  # whether op-amps have 1/f noise
    unit: str = "V"  # of `rms`

    @classmethod
    def of(cls, board: Board) -> OutputNoise | None:
        """Find the noise of `board`; None if its scene has no limit for it."""
        limit, models = board.scene.checks.noise, board.circuit.models.values()
        if limit is None:
            return None
        flickers = any(model.flicker_noise > 0.0 for model in models)
        lowest = limit.lowest or (LOWEST if flickers else 0.0)
        if not board.poles.known_stable:
            doubt = "" if board.poles.known_unstable else "the board may be unstable, and "
            return cls(unknown=doubt + UNSTABLE)
        try:
            rms, error = output_noise(board.linear, lowest)
            ngspice = board.engine == "ngspice"
            simulated = _simulated(board, int(rms.argmax()), lowest) if ngspice else None
        except (EngineError, SimulationError) as problem:
            return cls(unknown=f"the noise is not known: {problem}")
        named = {
            UNSTATED: [m.name for m in models
                       if m.voltage_noise == 0.0 and math.isfinite(m.gbw)],
            NO_CORNER: [m.name for m in models
                        if m.voltage_noise > 0.0 and m.voltage_noise_corner is None],
        }  # fmt: skip
        lacking, *notes = (text.format(", ".join(n)) if n else "" for text, n in named.items())
        bounds = tuple(rms.tolist()), tuple(error.tolist())
        return cls(*bounds, "", simulated, lacking, tuple(notes), lowest, flickers)

    @property
    def band(self) -> str:
        """The frequencies that count, in words."""
        if not self.lowest:
            return "over all frequencies"
        return f"above {show(self.lowest, 'Hz')}" + ", with 1/f noise" * self.flickers

    @property
    def worst(self) -> int:
        """Number of the channel with the largest noise, from 0."""
        return int(np.argmax(self.rms))

    @property
    def largest(self) -> float:
        """The largest noise of any channel, V."""
        return self.rms[self.worst]

    @property
    def known(self) -> float | None:
        """The largest noise of any channel, V; None where it is not known."""
        return None if self.unknown else self.largest

    @property
    def difference(self) -> float:
        """How far ngspice is from the state-space engine, V; 0 without ngspice."""
        return 0.0 if self.simulated is None else abs(self.simulated - self.largest)


def _simulated(board: Board, channel: int, lowest: float) -> float:
    """Return the noise of a channel above a frequency from ngspice, V."""
    bands = noise_bands(board.linear.state_space.modes.poles, lowest)
    node = board.circuit.outputs[channel].node
    deck = write_deck(board.circuit, NoiseAnalysis(bands), saved=[node])
    with Simulation(deck, find_simulator(), timeout=board.scene.analysis.timeout) as run:
        return run.accept(integrated_noise)
