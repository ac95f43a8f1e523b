"""What pruning changes and saves: the steady state, with its bound, and parts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.entries import pruned
from taction.system.array_types import Floats
from taction.system.errors import InputError
from taction.system.quantities import show
from taction.verification.reference.dynamics import IdealNetwork
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.problem import Solution, solution_difference


@dataclass(frozen=True, slots=True, eq=False)
class PruningEffect:
    """The steady state without the small entries of T.

    Attributes
    ----------
    entries : int
        Number of entries of T that the board leaves out.
    target : ndarray (N,)
        The optimum with the pruned T, V.
    change : float
        Largest deviation of `target` from the optimum with the whole T, V.
    bound : float
        On that deviation, with the errors of both optima, V; infinite if one is not trusted.
    """

    entries: int
    target: Floats
    change: float
    bound: float


def pruning_effect(
    network: IdealNetwork, fraction: float, solution: Solution
) -> PruningEffect | None:
    """Compare the solutions of the pruned and of the whole T; None if no entry is left out.

    Parameters
    ----------
    network : IdealNetwork
        With the whole T.
    fraction : float
        ``design.prune``.
    solution : Solution
        The solution of `network`.

    Raises
    ------
    SolverError
        The problem with the pruned T cannot be solved.
    """
    kept = pruned(network.T, fraction)
    entries = int(np.count_nonzero(kept != network.T))
    if not entries:
        return None
    after = replace(network, T=kept).rest
    change, bound = solution_difference(solution, after)
    return PruningEffect(entries, after.u * network.U0, change * network.U0, bound * network.U0)


@dataclass(frozen=True, slots=True, eq=False)
class Pruning:
    """The pruned board beside the board of the whole T.

    Attributes
    ----------
    effect : PruningEffect
        On the steady state.
    resistors, opamps : int or None
        How many fewer than with the whole T; None if that board cannot be built: the
        matrix can load the channels too much.
    """

    DOCUMENT = (
        *("entries = effect.entries", "change [V] = effect.change", "bound [V] = effect.bound"),
        *("resistors", "opamps"),
    )

    effect: PruningEffect
    resistors: int | None = None
    opamps: int | None = None

    @property
    def text(self) -> str:
        """The numbers in words."""
        effect = self.effect
        text = f"moves the steady state by {show(effect.change, 'V', 3)}"
        if math.isinf(effect.bound):
            text += ", without a bound: a solution is not trusted"
        if self.resistors is None:
            return f"{text}; with the whole T the board cannot be built"
        return f"{text}; saves {self.resistors} resistors and {self.opamps} op-amps"


def pruning_of(scene: Scene) -> Pruning | None:
    """Compare the board of `scene` with the board of the whole T; None if nothing is pruned.

    Raises
    ------
    InputError
        The pruned board cannot be built.
    NoVerdictError
        A problem cannot be solved.
    """
    if not scene.design.prune:
        return None
    problem = make_problem(scene)
    network = ideal_network(problem, scene)
    effect = pruning_effect(network, scene.design.prune, network.rest)
    if effect is None:
        return None
    kept = synthesise(scene, problem)
    unpruned = scene.model_copy(update={"design": scene.design.model_copy(update={"prune": 0.0})})
    try:
        whole = synthesise(unpruned, problem)
    except InputError:
        return Pruning(effect)
    fewer = _resistors(whole) - _resistors(kept)
    return Pruning(effect, fewer, len(whole.opamps) - len(kept.opamps))


def _resistors(circuit: Circuit) -> int:
    placed = (int(np.count_nonzero(np.isfinite(matrix.ohms))) for matrix in circuit.matrices)
    return len(circuit.resistors) + sum(placed)
