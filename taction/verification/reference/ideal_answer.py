"""What an ideal network does with a scene: steady state and transient."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.scene.fields import LARGE, SMALL
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.system import plugins
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.verification.reference.dynamics import (
    AT_ONCE,
    AtOnce,
    IdealNetwork,
    ideal_linear,
    ideal_transient,
    lambda_times_resistance,
)
from taction.verification.reference.problem import Solution
from taction.verification.reference.regularisers import REGULARISERS


@dataclass(frozen=True, eq=False)
class IdealAnswer:
    """Steady state and transient of the ideal network."""

    network: IdealNetwork
    band: float  # half-width of the settling band, a fraction of the step amplitude
    solution: Solution  # the reference steady state, dimensionless, with its certificate
    # `start`, `target`: (N,): u at t = 0 and at rest, V.
    start: Floats
    target: Floats
    error: float  # bound on the error of `target`, as a fraction of the step amplitude
    initial: Floats  # (N,): voltages of the signal nodes at t = 0, V
    problem: str  # why the steady state cannot be trusted; empty for a trusted one

    @functools.cached_property
    def settling_time(self) -> float:
        """Settling time of the transient to the scene's band, s; computed at the first use.

        Not a number where the transient cannot be integrated.
        """
        if not self.network.flows:
            return 0.0
        if self.network.amplifier == "linear":
            return ideal_linear(self.network, self.start, self.solution).settling_time(self.band)
        found = ideal_transient(self.network, self.initial, rest=self.solution)
        return np.nan if found is None else found.settling_time(self.band)


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


NETWORKS: Mapping[str, AtOnce] = plugins.OpenTable("taction.networks", AT_ONCE, AtOnce)
"""Networks without capacitors by their topologies; all others follow the flow of eq (9)."""


def is_biased(scene: Scene) -> bool:
    """Whether Omega has the term of the bias current, by the scene or by the paper's Omega."""
    bias = scene.design.bias
    return REGULARISERS[scene.design.amplifier].biased if bias is None else bias


def initial_voltages(scene: Scene, network: IdealNetwork) -> Floats:
    """Return v of every signal node when the strain steps on, shape (N,), V.

    SolverError: the scene starts from rest, and the network without strain has no solution.
    """
    if scene.analysis.initial == "zero" or network.amplifier == "linear":
        return np.zeros(network.T.shape[1])
    rest = replace(network, eps=np.zeros_like(network.eps)).rest
    return network.unit * (rest.v if rest.v is not None else rest.u)


def ideal_answer(network: IdealNetwork, scene: Scene) -> IdealAnswer:
    """Solve for the steady state; the transient starts from the initial state of the scene.

    SolverError: the solver can return no answer.
    """
    initial, solution = initial_voltages(scene, network), network.rest
    gain = REGULARISERS[network.amplifier].g
    start, target = network.U0 * gain(initial / network.unit), solution.u * network.U0
    amplitude = float(np.abs(target - start).max()) or 1.0
    return IdealAnswer(
        network=network,
        band=scene.checks.settling_time.band,
        solution=solution,
        start=start,
        target=target,
        error=solution.error_bound * network.U0 / amplitude,
        initial=initial,
        problem=solution.reason,
    )
