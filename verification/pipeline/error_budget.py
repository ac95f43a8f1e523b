"""The error budget of the outputs: each part is measured separately."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import realised_matrix
from netlist_gen.quantities import show
from spice_models.array_types import Floats
from verification.engines.statespace.linearised.equilibrium import Equilibrium
from verification.ideal.ideal_answer import IdealAnswer
from verification.pipeline.antilog_error import AntilogError, antilog_error, outputs_at
from verification.pipeline.design import Design
from verification.pipeline.output_noise import OutputNoise
from verification.pipeline.pruning import PruningEffect, pruning_effect
from verification.reference import IdealNetwork, lambda_times_resistance, solve


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """One part: the largest deviation of any channel, V, and the comparison that gives it.

    `value` is None if the deviation cannot be known, `bound` a proven bound on the value, V, where
    there is one.
    """

    name: str
    value: float | None
    how: str
    bound: float | None = None


def error_budget(
    design: Design,
    ideal: IdealAnswer,
    rest: Equilibrium,
    final: Floats,
    simulator: float,
    noise: OutputNoise | None = None,
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
    noise : OutputNoise, optional
        Noise of the outputs, if it was computed.

    Raises
    ------
    SolverError
        The steady state with the rounded resistors cannot be computed.
    """
    network, circuit, stress = design.network, design.circuit, design.problem.stress
    pruning = pruning_effect(network, design.scene.design.prune, ideal.solution)
    kept, pruned = (ideal.target, ()) if pruning is None else (pruning.target, (_pruned(pruning),))
    rounded = solve(rounded_network(network, circuit).problem).u * network.U0
    board, antilog = outputs_at(circuit, rest), antilog_error(design)
    stages = board if antilog is None else antilog.outputs
    truth = None if stress is None else stress * network.U0
    return (
        ErrorPart(
            "ill_posedness",
            None if truth is None else _largest(ideal.target - truth),
            "regularised optimum against the true stress (regularisation and noise)",
        ),
        *pruned,
        ErrorPart(
            "resistors",
            _largest(rounded - kept),
            "optimum with the rounded resistors against that of the exact resistors",
        ),
        ErrorPart(
            "opamps",
            _largest(stages - rounded),
            "equilibrium of the board against that optimum (finite gain, loading)",
        ),
        *(() if antilog is None else (_antilog(antilog, board),)),
        ErrorPart(
            "unsettled", _largest(final - board), "end of the record against that equilibrium"
        ),
        ErrorPart(
            "simulator", simulator, "comparison with a second solution, or bound on the rounding"
        ),
        *_noise(noise),
    )


def _noise(noise: OutputNoise | None) -> tuple[ErrorPart, ...]:
    if noise is None:
        return ()
    value = None if noise.unknown else noise.largest
    return (
        ErrorPart(
            "noise", value, "rms at rest over all frequencies: resistors, op-amps and sensors"
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


def _pruned(effect: PruningEffect) -> ErrorPart:
    bound = effect.bound if math.isfinite(effect.bound) else None
    proven = "no proven bound" if bound is None else f"proven bound {show(bound, 'V', 3)}"
    how = f"optimum without {effect.entries} entries of T against the requested optimum; {proven}"
    return ErrorPart("pruning", effect.change, how, bound)


def _antilog(error: AntilogError, board: Floats) -> ErrorPart:
    how = (
        "equilibrium with transistors against that with ideal antilog stages; the stages are up to"
        f" {100.0 * error.deviation:.2g} % from U0 exp(v/Ve), measured at u from"
        f" {show(error.lowest, 'V', 3)} to {show(error.highest, 'V', 3)}"
    )
    return ErrorPart("antilog", _largest(board - error.outputs), how)


def _largest(difference: Floats) -> float:
    return float(np.max(np.abs(difference), initial=0.0))
