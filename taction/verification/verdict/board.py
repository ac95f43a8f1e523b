"""`Board`: a board with all that is known of it before, or beside, its simulation.

What a verdict needs of a board and no record can change is a property here, computed at its first
use. The noise of the outputs is integrated in bands of frequencies, in which the analysis follows
every resonance of a board.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from taction.netlist_gen.analysis import NoiseAnalysis, NoiseBand, Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.check_keys import LOWEST, Tolerances
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.input_errors import MOST
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError, SimulationError
from taction.system.quantities import show
from taction.system.reading_definitions import FOUND
from taction.verification.engines.ngspice.evidence import integrated_noise
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.engines.statespace.linearised.time_scales import TimeScales
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.readings.exact_measures import ExactResponse
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import IdealAnswer, IdealNetwork, ideal_answer
from taction.verification.stability.margin import REACH, Margin, find_margin
from taction.verification.stability.poles import Poles
from taction.verification.verdict.headroom import NOT_LIMITED, PartLoads
from taction.verification.verdict.input_spread import NOTHING, InputSpread, covered, outputs_at_rest
from taction.verification.verdict.transient_plan import TransientPlan


@dataclass(frozen=True, slots=True, eq=False)
class SteadyState:
    """The equilibrium of a board at its outputs."""

    values: Floats  # (N,): outputs at the equilibrium, V
    error: float  # bound on the rounding error of `values`, V
    scales: TimeScales  # modes of the board
    linear: bool  # whether the board has no behavioural amplifiers
    estimated: bool = False  # whether `left` is an estimate: of large boards, and if not `linear`

    @classmethod
    def of(cls, board: LinearBoard, scales: TimeScales) -> SteadyState:
        """Return the steady state of `board`; `EngineError` if it has no equilibrium."""
        places = [board.descriptor.place(output.node) for output in board.circuit.outputs]
        error, linear = float(board.rounding[places].max(initial=0.0)), board.circuit.is_linear
        estimated = not linear or board.descriptor.is_large
        return cls(outputs_at_rest(board), error, scales, linear, estimated)

    def left(self, time: float) -> float:
        """Return the largest distance of an output from `values` at an instant, s; V."""
        return self.scales.step * self.scales.left(time)

    def stop_for(self, volts: float) -> float:
        """Return the instant after which every output stays within `volts` of `values`, s."""
        return self.scales.stop_for(volts / (self.scales.step or 1.0))


NEAR = 1e-3  # of the limit of an excursion: error to which that is found

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


@dataclass(frozen=True, eq=False)
class Board:
    """A board, its problem, and the plan of its simulation."""

    scene: Scene  # scene with a number for lambda
    problem: InverseProblem
    network: IdealNetwork  # the board with ideal parts, for the reference solution
    linear: LinearBoard  # the circuit linearised at its equilibrium
    scales: TimeScales
    poles: Poles
    engine: str  # a key of `taction.verification.verdict.simulation.ENGINES`
    plan: TransientPlan  # the transient, and the forecast of its error and cost
    answer: IdealAnswer | None = None  # the reference solution, where it was known before
    full_margin: bool = True  # whether `margin` is searched up to `REACH`
    small: PartLoads = NOT_LIMITED  # loads of the op-amps of the small-signal board

    @property
    def circuit(self) -> Circuit:
        """The circuit of the board."""
        return self.linear.circuit

    @property
    def transient(self) -> Transient:
        """The transient to simulate."""
        return self.plan.transient

    @cached_property
    def ideal(self) -> IdealAnswer:
        """The reference solution; SolverError as `ideal_answer`."""
        return self.answer or ideal_answer(self.network, self.scene)

    @property
    def amplitude(self) -> float:
        """The step amplitude of the network, V."""
        return float(np.abs(self.ideal.target - self.ideal.start).max(initial=0.0))

    @cached_property
    def steady(self) -> SteadyState:
        """Where the board rests; EngineError: it has no equilibrium."""
        return SteadyState.of(self.linear, self.scales)

    @cached_property
    def margin(self) -> Margin | None:
        """The stability margin; None if the scene asks for none."""
        required = self.scene.checks.stability.margin
        if required <= 1.0:
            return None
        reach = max(required, REACH) if self.full_margin else required
        return find_margin(self.linear, reach=reach, found=self.poles)

    @cached_property
    def exact(self) -> Measurements | None:
        """The readings of the exact solution; None where it is not known, or a mode stays."""
        if not (self.poles.known_stable and is_exact(self.linear)):
            return None
        checks = self.scene.checks
        limits = [each.max for each in (checks.overshoot, checks.undershoot) if each is not None]
        try:
            return ExactResponse(
                self.linear,
                self.ideal.target,
                self.ideal.start,
                initial=self.transient.initial,
                band=checks.settling_time.band,
                target_error=self.target_error,
                level=min([FOUND, *(NEAR * limit for limit in limits)]),
            ).measured()
        except EngineError:
            return None

    @property
    def target_error(self) -> float:
        """Bound of the error of an output's distance from the reference, V; it moves the band."""
        return 2.0 * self.ideal.solution.error_bound * self.ideal.network.U0

    @cached_property
    def loads(self) -> PartLoads:
        """What the op-amps of the board have to do."""
        if not self.poles.known_stable or self.circuit.is_small_signal:
            return self.small
        found = PartLoads.of(self.linear, self.transient, self.plan.tolerance)
        simulated = tuple(load for load in self.small.loads if load.is_above)
        return replace(found, simulated=simulated)

    @cached_property
    def noise(self) -> OutputNoise | None:
        """The noise of the outputs at rest; None if the scene has no limit for it."""
        limit, models = self.scene.checks.noise, self.circuit.models.values()
        if limit is None:
            return None
        flickers = any(model.flicker_noise > 0.0 for model in models)
        lowest = limit.lowest or (LOWEST if flickers else 0.0)
        if not self.poles.known_stable:
            doubt = "" if self.poles.known_unstable else "the board may be unstable, and "
            return OutputNoise(unknown=doubt + UNSTABLE)
        try:
            rms, error = output_noise(self.linear, lowest)
            ngspice = self.engine == "ngspice"
            simulated = self._simulated_noise(int(rms.argmax()), lowest) if ngspice else None
        except (EngineError, SimulationError) as problem:
            return OutputNoise(unknown=f"the noise is not known: {problem}")
        named = {
            UNSTATED: [m.name for m in models
                       if m.voltage_noise == 0.0 and math.isfinite(m.gbw)],
            NO_CORNER: [m.name for m in models
                        if m.voltage_noise > 0.0 and m.voltage_noise_corner is None],
        }  # fmt: skip
        lacking, *notes = (text.format(", ".join(n)) if n else "" for text, n in named.items())
        bounds = tuple(rms.tolist()), tuple(error.tolist())
        return OutputNoise(*bounds, "", simulated, lacking, tuple(notes), lowest, flickers)

    def _simulated_noise(self, channel: int, lowest: float) -> float:
        """Return the noise of a channel above a frequency from ngspice, V."""
        bands = noise_bands(self.linear.state_space.modes.poles, lowest)
        node = self.circuit.outputs[channel].node
        deck = write_deck(self.circuit, NoiseAnalysis(bands), saved=[node])
        with Simulation(deck, find_simulator(), timeout=self.scene.analysis.timeout) as run:
            return run.accept(integrated_noise)

    @cached_property
    def spread(self) -> InputSpread | None:
        """Where boards of the same parts rest; None if all rest at one place, or none."""
        return self.built_spread(NOTHING)

    def built_spread(self, tolerances: Tolerances) -> InputSpread | None:
        """Return where boards rest whose parts have these tolerances; None as for `spread`."""
        stable = self.poles.known_stable
        return InputSpread.shared(self.linear, self._drift, tolerances) if stable else None

    @property
    def varies(self) -> tuple[str, ...]:
        """What differs between the boards of `built_spread`, and of `spread`, in words."""
        every, drift = (self.scene.tolerances, NOTHING), bool(self._drift)
        return tuple(covered(self.circuit, each, drift=drift) for each in every)

    @property
    def _drift(self) -> float:
        """Standard deviation of the change of each resistor by temperature, a fraction."""
        wanted = self.scene.design
        return wanted.temperature_coefficient * abs(wanted.surroundings.kelvin) / MOST

    def volts(self, share: float) -> float:
        """Return a share of the step in V; infinite without a step, or if it may grow."""
        step = self.scales.step if self.poles.known_stable else 0.0
        return share * step or math.inf
