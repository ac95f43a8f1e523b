"""The error budget of the outputs: each part is measured separately."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import realised_matrix
from spice_models.array_types import Floats
from verification.engines.statespace.linearised.equilibrium import Equilibrium
from verification.ideal.ideal_answer import IdealAnswer
from verification.pipeline.design import Design
from verification.reference import IdealNetwork, lambda_times_resistance, solve


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """One part: the largest deviation of any channel, V, and the comparison that gives it.

    `value` is None if the deviation cannot be known.
    """

    name: str
    value: float | None
    how: str


def error_budget(
    design: Design, ideal: IdealAnswer, rest: Equilibrium, final: Floats, simulator: float
) -> tuple[ErrorPart, ...]:
    """Split the difference of the true stress and the simulated outputs into its parts.

    Parameters
    ----------
    rest : Equilibrium
        Equilibrium of the board, from the state-space equations.
    final : ndarray (N,)
        Outputs at the end of the record, V.
    simulator : float
        Error of the simulation, V.

    Raises
    ------
    SolverError
        The steady state with the rounded resistors cannot be computed.
    """
    network, circuit, stress = design.network, design.circuit, design.problem.stress
    rounded = solve(rounded_network(network, circuit).problem).u * network.U0
    board = np.array([out.sign * rest[out.node] for out in circuit.outputs])
    truth = None if stress is None else stress * network.U0
    return (
        ErrorPart(
            "ill_posedness",
            None if truth is None else _largest(ideal.target - truth),
            "regularised optimum against the true stress (regularisation and noise)",
        ),
        ErrorPart(
            "resistors",
            _largest(rounded - ideal.target),
            "optimum with the rounded resistors against the requested optimum",
        ),
        ErrorPart(
            "opamps",
            _largest(board - rounded),
            "equilibrium of the board against that optimum (finite gain, loading)",
        ),
        ErrorPart(
            "unsettled", _largest(final - board), "end of the record against that equilibrium"
        ),
        ErrorPart(
            "simulator", simulator, "comparison with a second solution, or bound on the rounding"
        ),
    )


def rounded_network(network: IdealNetwork, circuit: Circuit) -> IdealNetwork:
    """Return `network` with T and lambda of the resistor values of `circuit`."""
    scalings = circuit.scalings
    ohms = {resistor.name: resistor.ohms for resistor in circuit.resistors}
    gains = [value for name, value in ohms.items() if name.startswith("s_")]
    product = lambda_times_resistance(
        network.amplifier,
        s=gains[0] if gains else scalings.gain,
        G0=scalings.unit_conductance,
        U0=network.U0,
        Ve=network.Ve,
    )
    integrator = circuit.topology == "integrator"
    R = ohms["r_1"] if integrator else scalings.resistance
    return replace(network, T=realised_matrix(circuit), lam=product / R)


def _largest(difference: Floats) -> float:
    return float(np.max(np.abs(difference), initial=0.0))
