"""The error budget of the outputs: each part is measured separately."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Floats
from verification.engines.statespace.linearised.equilibrium import Equilibrium
from verification.ideal.ideal_answer import IdealAnswer, rounded_network
from verification.pipeline.design import Design
from verification.reference import solve


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


def _largest(difference: Floats) -> float:
    return float(np.max(np.abs(difference), initial=0.0))
