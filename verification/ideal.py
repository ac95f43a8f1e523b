"""The first witness's answer for a scene: what an ideal network settles to, and how fast."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.circuit import Circuit, Floats, Scalings
from netlist_gen.problem import InverseProblem
from netlist_gen.scene import Scene
from netlist_gen.synthesis import realised_matrix
from verification.reference import IdealNetwork, Solution, ideal_linear, ideal_transient, solve
from verification.reference.dynamics import Outcome, ScaledNetwork, energy_residual
from verification.reference.response import Response

ENERGY_STRIDE = 20  # of the response's instants, which are 1 % apart


@dataclass(frozen=True, slots=True, eq=False)
class IdealAnswer:
    """Steady state and transient of the ideal network.

    Attributes
    ----------
    solution : Solution
        The reference steady state, dimensionless, with its certificate.
    start, target : ndarray (N,)
        u at t = 0 and at rest, V.
    settling_time : float
        To the scene's band, s; not a number where the transient cannot be trusted.
    rise_times : ndarray (N,)
        10-90 %, s; not a number where a channel's step is too small.
    error : float
        Bound on the error of `target`, as a fraction of the step amplitude.
    energy_residual : float
        How far the transient is from losing what it dissipates, relative (see
        `verification.reference.dynamics.energy_residual`).
    problem : str
        Why the answer cannot be believed; empty if it can.
    """

    solution: Solution
    start: Floats
    target: Floats
    settling_time: float
    rise_times: Floats
    error: float
    energy_residual: float
    problem: str


def ideal_network(problem: InverseProblem, scalings: Scalings, scene: Scene) -> IdealNetwork:
    """Return the ideal network of `problem` with the scene's own numbers, nothing rounded."""
    return IdealNetwork(
        T=problem.matrix,
        eps=problem.strain,
        G0=scalings.unit_conductance,
        U0=scalings.unit_voltage,
        R=scalings.resistance,
        C=scalings.capacitance,
        s=scalings.gain,
        amplifier=scene.design.amplifier,
        Ve=scalings.exponential_slope,
        bias=scene.design.biased,
    )


def rounded_network(network: IdealNetwork, circuit: Circuit) -> IdealNetwork:
    """Return `network` with the resistors that `circuit` really has."""
    ohms = {resistor.name: resistor.ohms for resistor in circuit.resistors}
    gains = [value for name, value in ohms.items() if name.startswith("s_")]
    changed = replace(network, T=realised_matrix(circuit), s=gains[0] if gains else network.s)
    return changed if circuit.topology == "passive" else replace(changed, R=ohms["r_1"])


def initial_voltages(scene: Scene, network: IdealNetwork) -> Floats:
    """Return v of every signal node when the strain steps on, shape (N,), V.

    Raises
    ------
    SolverError
        The scene starts from rest, and the network without strain has no solution.
    """
    if scene.analysis.initial == "zero" or network.amplifier == "linear":
        return np.zeros(network.T.shape[1])
    asleep = solve(replace(network, eps=np.zeros_like(network.eps)).problem)
    return network.unit * (asleep.v if asleep.v is not None else asleep.u)


def ideal_answer(network: IdealNetwork, scene: Scene) -> IdealAnswer:
    """Solve for the steady state, and for the transient from the scene's initial state.

    Raises
    ------
    SolverError
        Nothing at all can be returned.
    """
    initial = initial_voltages(scene, network)
    band = scene.checks.settling_time.band
    if network.amplifier == "linear":
        solution = solve(network.problem)
        exact = ideal_linear(network, initial)
        trusted, why, residual = True, "", _linear_residual(network, exact)
        response: Response | None = exact
    else:
        transient = ideal_transient(network, initial)
        solution, response = transient.rest, transient.response
        trusted, why = transient.outcome is Outcome.TRUSTED, transient.outcome.value
        residual = transient.energy_residual
    target = solution.u * network.U0
    if response is None or not trusted:
        nothing = np.full(len(target), np.nan)
        start = response.start if response is not None else np.full(len(target), np.nan)
        why = solution.reason or why
        return IdealAnswer(solution, start, target, np.nan, nothing, np.inf, residual, why)
    amplitude = response.amplitude or 1.0
    return IdealAnswer(
        solution=solution,
        start=response.start,
        target=target,
        settling_time=response.settling_time(band),
        rise_times=response.rise_times(),
        error=solution.error_bound * network.U0 / amplitude,
        energy_residual=residual,
        problem="" if solution.trusted else solution.reason,
    )


def _linear_residual(network: IdealNetwork, response: Response) -> float:
    unit = network.R * network.C

    def dense(t: Floats) -> Floats:
        return response.outputs(t * unit).T / network.U0

    return energy_residual(ScaledNetwork(network), response.time[::ENERGY_STRIDE] / unit, dense)
