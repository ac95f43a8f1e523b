"""The ideal network of a scene: its steady state.

``C dv/dt = -v/R - I_b - s G0 T^T (G0 T u - G0 U0 eps)``, ``u = U0 g(v/Ve)`` (eq 9 as corrected). In
``x = v/Ve`` and ``t/(R C)`` this is ``dx = -(x + beta) - T^T (T g(x) - eps) / mu``: of all its
components only mu, a multiple of lambda, is left. Its rest state solves the reference problem.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.scene.fields import LARGE, SMALL
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.system import plugins
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.verification.reference.problem import Problem, Solution
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.solve import solve, solve_square


@dataclass(frozen=True, slots=True)
class AtOnce:
    """A network without capacitors: with ideal op-amps it is at rest at once."""

    solver: Callable[[Problem], Solution]  # solves the problem of its rest
    regularised: bool = False  # whether lambda stands in it; else it is 0


@dataclass(frozen=True, slots=True, eq=False)
class IdealNetwork:
    """A problem as a network with ideal op-amps; it has no components."""

    T: Floats  # (M, N)
    eps: Floats  # (M,)
    lam: float  # regularisation parameter
    RC: float  # time constant of a signal node, s; 0 of a network without capacitors
    U0: float = 1.0  # unit voltage, V
    amplifier: str = "linear"  # a key of `REGULARISERS`
    Ve: float = 1.0  # slope of a nonlinear amplifier, V; unused by the linear amplifier
    bias: bool = False  # whether ``I_b = Ve / R`` flows
    solver: Callable[[Problem], Solution] = solve
    ridge_share: float = 1.0  # share of the ridge term that stays

    @property
    def rest(self) -> Solution:
        """Solution of the network's problem, by its own solver.

        SolverError: the solver can return no answer.
        """
        return self.solver(self.problem)

    @property
    def mu(self) -> float:
        """Lambda for linear amplifiers, half of lambda for the others."""
        return self.lam * REGULARISERS[self.amplifier].weight

    @property
    def problem(self) -> Problem:
        """Problem that the network's rest state solves."""
        return Problem(self.T, self.eps, self.lam, self.amplifier, self.bias, self.ridge_share)


def lambda_times_resistance(
    amplifier: str, *, s: float, G0: float, U0: float = 1.0, Ve: float = 1.0
) -> float:
    """Return the product of lambda and the feedback resistor R of a board, ohm.

    In the equation of the network above ``mu = unit / (R s G0^2 U0)``, where `unit` is U0 for
    linear amplifiers and Ve for all others; ``lambda = mu / weight``, with the weight of eq (8) or
    (21) as corrected. The synthesis of the board has a formula of its own for the same product.

    `s`: gain of the constraint plane, ohm; `G0`: unit conductance, S.
    `U0`, `Ve`: unit voltage and slope of the amplifier, V.
    """
    volts = 1.0 if amplifier == "linear" else Ve / U0
    return volts / REGULARISERS[amplifier].weight / G0 / G0 / s


@dataclass(frozen=True, eq=False)
class IdealAnswer:
    """Start and steady state of the ideal network."""

    network: IdealNetwork
    solution: Solution  # the reference steady state, dimensionless, with its certificate
    # `start`, `target`: (N,): u at t = 0 and at rest, V.
    start: Floats
    target: Floats
    error: float  # bound on the error of `target`, as a fraction of the step amplitude
    problem: str  # why the steady state cannot be trusted; empty for a trusted one


def ideal_network(problem: InverseProblem, scene: Scene) -> IdealNetwork:
    """Return the ideal network of `problem`, with lambda and the units that `scene` asks for.

    It reads the scene alone, no number of the synthesis. Where the scene gives R, lambda follows
    from the reference's own formula.

    InputError: lambda is no number, or out of range.
    """
    design = scene.design
    at_once = NETWORKS.get(design.topology)
    if at_once is not None:
        lam = design.lam if at_once.regularised else 0.0
        if not isinstance(lam, int | float):
            text = "the problem needs a number for lambda"
            raise InputError(scene.file, Complaint("design.lambda", repr(lam), text))
        T, eps, volts = problem.matrix, problem.strain, design.unit_voltage
        return IdealNetwork(T, eps, float(lam), RC=0.0, U0=volts, solver=at_once.solver)
    kind, slope = design.amplifier, design.exponential_slope or 1.0
    product = lambda_times_resistance(
        kind, s=design.gain, G0=design.unit_conductance, U0=design.unit_voltage, Ve=slope
    )
    lam = design.lam
    if lam is None:
        lam = product / (design.resistance or DEFAULT_RESISTANCE)
    if isinstance(lam, str) or not SMALL <= lam <= LARGE:
        text = f"the problem needs a number between {SMALL:g} and {LARGE:g} for lambda"
        raise InputError(scene.file, Complaint("design.lambda", repr(lam), text))
    return IdealNetwork(
        T=problem.matrix,
        eps=problem.strain,
        lam=lam,
        RC=product / lam * design.capacitance,
        U0=design.unit_voltage,
        amplifier=kind,
        Ve=slope,
        bias=is_biased(scene),
        ridge_share=design.ridge_share,
    )


NETWORKS: Mapping[str, AtOnce] = plugins.OpenTable(
    "taction.networks",
    {
        "inv": AtOnce(solve_square),
        "pinv": AtOnce(solve),
        "ridge": AtOnce(solve, regularised=True),
    },
    AtOnce,
)
"""Networks without capacitors by their topologies; all others follow the flow of eq (9)."""


def is_biased(scene: Scene) -> bool:
    """Whether Omega has the term of the bias current, by the scene or by the paper's Omega."""
    bias = scene.design.bias
    return REGULARISERS[scene.design.amplifier].biased if bias is None else bias


def ideal_answer(network: IdealNetwork, scene: Scene) -> IdealAnswer:
    """Solve for the steady state; the transient starts from the initial state of the scene.

    SolverError: the solver can return no answer, or none for a start from rest, without strain.
    """
    before = REGULARISERS[network.amplifier].g(np.zeros(network.T.shape[1]))
    if scene.analysis.initial != "zero" and network.amplifier != "linear":
        before = replace(network, eps=np.zeros_like(network.eps)).rest.u
    solution = network.rest
    start, target = network.U0 * before, solution.u * network.U0
    amplitude = float(np.abs(target - start).max()) or 1.0
    return IdealAnswer(
        network=network,
        solution=solution,
        start=start,
        target=target,
        error=solution.error_bound * network.U0 / amplitude,
        problem=solution.reason,
    )
