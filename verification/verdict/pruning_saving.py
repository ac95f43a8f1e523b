"""What pruning changes and saves: the steady state, parts, and the time of a run by ngspice."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError, NoVerdictError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.reference import solve
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.verdict.pruning import PruningEffect, pruning_effect
from taction.verification.verdict.simulation import begin
from taction.verification.verdict.transient_plan import Plan, plan_transient

STEPS = 100  # of the timed runs
ANY_ERROR = 1e3  # truncation error: all steps of the timed runs have the largest size


@dataclass(frozen=True, slots=True, eq=False)
class Pruning:
    """The pruned board beside the board of the whole T.

    Attributes
    ----------
    effect : PruningEffect
        On the steady state.
    resistors, opamps : int or None
        How many fewer than with the whole T; None if that board cannot be built: in the passive
        topology the matrix can load the channels too much.
    seconds, whole_seconds : float or None
        Measured wall time of `STEPS` steps by ngspice with the pruned and with the whole T, s; None
        without ngspice or without the board of the whole T.
    """

    effect: PruningEffect
    resistors: int | None = None
    opamps: int | None = None
    seconds: float | None = None
    whole_seconds: float | None = None

    @property
    def text(self) -> str:
        """The numbers in words."""
        effect, proven = self.effect, "no proven bound"
        if math.isfinite(effect.bound):
            proven = f"proven: at most {show(effect.bound, 'V', 3)}"
        text = f"moves the steady state by {show(effect.change, 'V', 3)} ({proven})"
        if self.resistors is None:
            return f"{text}; with the whole T the board cannot be built"
        text += f"; saves {self.resistors} resistors and {self.opamps} op-amps"
        if self.seconds is None or self.whole_seconds is None:
            return text
        times = (show(seconds, "s", 3) for seconds in (self.seconds, self.whole_seconds))
        return f"{text}; {STEPS} steps of ngspice take {' instead of '.join(times)}"

    @property
    def record(self) -> dict[str, Any]:
        """The numbers as plain data, SI base units."""
        effect = {name: getattr(self.effect, name) for name in ("entries", "change", "bound")}
        names = ("resistors", "opamps", "seconds", "whole_seconds")
        return effect | {name: getattr(self, name) for name in names}


def pruning_of(scene: Scene) -> Pruning | None:
    """Compare the board of `scene` with the board of the whole T; None if nothing is pruned.

    Raises
    ------
    InputError
        The pruned board cannot be built.
    NoVerdictError
        A problem cannot be solved, or the board has no equilibrium.
    """
    if not scene.design.prune:
        return None
    problem = make_problem(scene)
    network = ideal_network(problem, scene)
    effect = pruning_effect(network, scene.design.prune, solve(network.problem))
    if effect is None:
        return None
    pruned = synthesise(scene, problem)
    unpruned = scene.model_copy(update={"design": scene.design.model_copy(update={"prune": 0.0})})
    try:
        whole = synthesise(unpruned, problem)
    except InputError:
        return Pruning(effect)
    board = LinearBoard(pruned)
    plan = plan_transient(scene, board, time_scales(board, initial=scene.analysis.initial))
    return Pruning(
        effect=effect,
        resistors=_resistors(whole) - _resistors(pruned),
        opamps=len(whole.opamps) - len(pruned.opamps),
        seconds=_seconds(scene, pruned, plan),
        whole_seconds=_seconds(scene, whole, plan),
    )


def _resistors(circuit: Circuit) -> int:
    placed = (int(np.count_nonzero(np.isfinite(matrix.ohms))) for matrix in circuit.matrices)
    return len(circuit.resistors) + sum(placed)


def _seconds(scene: Scene, circuit: Circuit, plan: Plan) -> float | None:
    """Return the wall time of a short run by ngspice; None without a finished run."""
    stop = STEPS * plan.transient.max_step
    short = replace(plan.transient, stop=stop, truncation=ANY_ERROR)
    timed = replace(plan, transient=short, growing=False, seconds=0.0)
    try:
        return begin(scene, LinearBoard(circuit), timed, "ngspice").result().waveforms.cost.seconds
    except NoVerdictError:
        return None
