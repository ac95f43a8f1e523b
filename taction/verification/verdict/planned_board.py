"""A board with all that is known before its simulation: poles, time scales, plan, place of rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.spice_models.input_errors import MOST
from taction.system.array_types import Floats
from taction.system.reading_definitions import FOUND
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales
from taction.verification.reference.dynamics import IdealNetwork
from taction.verification.stability.poles import Poles
from taction.verification.verdict.headroom import NOT_LIMITED, PartLoads
from taction.verification.verdict.input_spread import NOTHING, InputSpread, covered
from taction.verification.verdict.transient_plan import TransientPlan


@dataclass(frozen=True, slots=True, eq=False)
class UnplannedBoard:
    """The board of a scene before anything is computed from it."""

    scene: Scene  # scene with a number for lambda
    problem: InverseProblem
    board: LinearBoard  # the circuit linearised at its equilibrium
    network: IdealNetwork  # the board with ideal parts, for the reference solution


@dataclass(frozen=True, slots=True, eq=False)
class PlannedBoard(UnplannedBoard):
    """A board, its problem, and the plan of its simulation."""

    # `poles`, `scales`: poles and time scales of `board`.
    scales: TimeScales
    poles: Poles
    engine: str  # a key of `taction.verification.verdict.simulation.ENGINES`
    plan: TransientPlan  # the transient, and the forecast of its error and cost
    # Loads of the op-amps of the small-signal board; empty for an unstable board.
    small: PartLoads = NOT_LIMITED

    def loads(self) -> PartLoads:
        """Return what the op-amps of the board have to do."""
        if not self.poles.known_stable or self.circuit.is_small_signal:
            return self.small
        plan = self.plan
        found = PartLoads.of(self.board, transient=plan.transient, tolerance=plan.tolerance)
        return found.beside(self.small)

    def spread(self) -> InputSpread | None:
        """Return where boards of the same parts rest; None if all rest at one place, or none."""
        if not self.poles.known_stable:
            return None
        return InputSpread.of(self.board, self._drift)

    def built_spread(self) -> InputSpread | None:
        """Return where built boards rest: parts have the tolerances of the scene, too."""
        if not self.poles.known_stable:
            return None
        return InputSpread.of(self.board, self._drift, self.scene.tolerances)

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

    @property
    def rest(self) -> Callable[[str], float] | None:
        """The voltages of the nodes at rest, V; None for a board that may be unstable."""
        return self.board.equilibrium.__getitem__ if self.poles.known_stable else None

    @property
    def wanted(self) -> float:
        """Largest error that the checks allow, V; infinite without a step, or if it may grow."""
        return self._volts(self.plan.wanted)

    @property
    def reading_error(self) -> float:
        """Error to which readings are found, V: `FOUND`, or less where the checks allow less."""
        return self._volts(min(self.plan.wanted, FOUND))

    def _volts(self, share: float) -> float:
        step = self.scales.step if self.poles.known_stable else 0.0
        return share * step or math.inf

    @property
    def transient(self) -> Transient:
        """The transient to simulate."""
        return self.plan.transient

    @property
    def circuit(self) -> Circuit:
        """The circuit of the board."""
        return self.board.circuit


@dataclass(frozen=True, slots=True, eq=False)
class SteadyState:
    """The equilibrium of a board at its outputs."""

    values: Floats  # (N,): outputs at the equilibrium, V
    error: float  # bound on the rounding error of `values`, V
    scales: TimeScales  # modes of the board
    linear: bool  # whether the board has no behavioural amplifiers
    # Whether `left` is an estimate: for a board with behavioural amplifiers, and for the coarse
    # image of a large board.
    estimated: bool = False

    @classmethod
    def of(cls, board: LinearBoard, scales: TimeScales) -> SteadyState:
        """Return the steady state of `board`, whose modes are in `scales`.

        EngineError: the board has no equilibrium.
        """
        rest, outputs = board.equilibrium, board.circuit.outputs
        places = [board.descriptor.place(output.node) for output in outputs]
        signs = np.array([output.sign for output in outputs])
        error = float(board.rounding[places].max(initial=0.0))
        linear = board.circuit.is_linear
        estimated = not linear or board.descriptor.is_large
        return cls(signs * rest.values[places], error, scales, linear, estimated)

    def left(self, time: float) -> float:
        """Return the largest distance of an output from `values` at an instant, s; V."""
        return self.scales.step * self.scales.left(time)

    def stop_for(self, volts: float) -> float:
        """Return the instant after which every output stays within `volts` of `values`, s."""
        return self.scales.stop_for(volts / (self.scales.step or 1.0))
