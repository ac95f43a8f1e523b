"""The board of a scene, with its poles, time scales and plan, before any simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.reference import IdealNetwork
from taction.verification.reference.ideal_answer import ideal_network, resolve_lambda
from taction.verification.stability.poles import Poles, poles_behind
from taction.verification.verdict.clock import Clock
from taction.verification.verdict.opamp_level import at_level
from taction.verification.verdict.part_limits import NOT_LIMITED, PartLoads
from taction.verification.verdict.simulation import choose_engine
from taction.verification.verdict.transient_plan import Plan, plan_transient


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """A board, its problem, and the plan of its simulation.

    Attributes
    ----------
    scene : Scene
        Scene with a number for lambda.
    network : IdealNetwork
        The board with ideal parts, for the reference solution.
    board : LinearBoard
        The circuit linearised at its equilibrium.
    poles, scales
        Poles and time scales of `board`.
    engine : str
        A key of `taction.verification.verdict.simulation.ENGINES`.
    plan : Plan
        The transient, and the forecast of its error and cost.
    small : PartLoads
        Loads of the op-amps of the small-signal board; empty for an unstable board.
    """

    scene: Scene
    problem: InverseProblem
    board: LinearBoard
    network: IdealNetwork
    scales: TimeScales
    poles: Poles
    engine: str
    plan: Plan
    small: PartLoads = NOT_LIMITED

    def loads(self) -> PartLoads:
        """Return what the op-amps of the board have to do."""
        if not self.poles.known_stable or self.circuit.is_small_signal:
            return self.small
        found = PartLoads.of(self.board, transient=self.transient)
        return replace(found, simulated=tuple(x for x in self.small.worst if x.is_above))

    @property
    def transient(self) -> Transient:
        """The transient to simulate."""
        return self.plan.transient

    @property
    def circuit(self) -> Circuit:
        """The circuit of the board."""
        return self.board.circuit


def design_board(
    scene: Scene,
    clock: Clock,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
) -> Design:
    """Synthesise the board of `scene` and plan its transient.

    `problem` and `circuit` replace those of the scene.

    Raises
    ------
    InputError, NoVerdictError
        As `taction.verification.verdict.verify.verify`.
    """
    clock.begin("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene) if problem is None else problem
    board = LinearBoard.of(synthesise(scene, problem) if circuit is None else circuit)
    network = ideal_network(problem, scene)
    clock.begin("poles")
    design = _designed(scene, problem, board, network)
    stable = design.poles.known_stable
    leveled, small = at_level(scene, board, design.transient, stable=stable)
    if leveled is not board:
        design = _designed(scene, problem, leveled, network)
    return replace(design, small=small)


def _designed(
    scene: Scene, problem: InverseProblem, board: LinearBoard, network: IdealNetwork
) -> Design:
    scales = time_scales(board, initial=scene.analysis.initial)
    poles = poles_behind(board, scales)
    scales = scales.with_slower(poles.rightmost)
    engine = choose_engine(scene)
    stable = not poles.known_unstable
    plan = plan_transient(scene, board, scales, engine, stable=stable, resolution=poles.resolution)
    return Design(scene, problem, board, network, scales, poles, engine, plan)
