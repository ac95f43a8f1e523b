"""`Board`: a board with all that is known of it before, or beside, its simulation.

What a verdict needs of a board and no record can change is a property here, computed at its first
use.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.input_errors import MOST
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
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
        try:
            return ExactResponse(
                self.linear,
                self.ideal.target,
                self.ideal.start,
                initial=self.transient.initial,
                band=self.scene.checks.settling_time.band,
                target_error=self.target_error,
                level=0.0,
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
    def spread(self) -> InputSpread | None:
        """Where boards of the same parts rest; None if all rest at one place, or none."""
        return self.built_spread(NOTHING)

    def built_spread(self, tolerances: Tolerances) -> InputSpread | None:
        """Return where boards rest whose parts have these tolerances; None as for `spread`."""
        stable = self.poles.known_stable
        return InputSpread.of(self.linear, self._drift, tolerances) if stable else None

    @property
    def varies(self) -> tuple[str, str]:
        """What differs between the boards of `built_spread`, and of `spread`, in words."""
        every, drift = (self.scene.tolerances, NOTHING), bool(self._drift)
        built, alike = (covered(self.circuit, each, drift=drift) for each in every)
        return built, alike

    @property
    def _drift(self) -> float:
        """Standard deviation of the change of each resistor by temperature, a fraction."""
        wanted = self.scene.design
        return wanted.temperature_coefficient * abs(wanted.surroundings.kelvin) / MOST

    def volts(self, share: float) -> float:
        """Return a share of the step in V; infinite without a step, or if it may grow."""
        step = self.scales.step if self.poles.known_stable else 0.0
        return share * step or math.inf
