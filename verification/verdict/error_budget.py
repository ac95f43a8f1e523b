"""The error budget of the outputs: a chain of solutions, whose differences are its parts.

    true stress -> optimum -> pruned T -> resistors as built -> op-amps, one link for each group of
    their figures -> end of the exact transient -> end of the record

Each part is the signed difference of two solutions that follow each other, for every channel, so
the parts add up to the difference of the record's end and the true stress. Noise has no sign: it
stands beside the sum.
"""

from __future__ import annotations

import math
from functools import partial

from taction.netlist_gen.topologies.frame.antilog import with_ideal_stages
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.antilog_error import stage_deviation
from taction.verification.verdict.error_chain import ErrorBudget, ErrorChain, ErrorPart, difference
from taction.verification.verdict.opamp_links import (
    opamp_stages,
    outputs_at_rest,
    with_ideal_opamps,
)
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.pruning import PruningEffect, pruning_effect
from taction.verification.verdict.recording import Recording
from taction.verification.verdict.rounding_forecast import predicted_change

LEAST_BOUND = 1e-9  # of the step: a smaller bound on an error has no number of its own


def error_budget(
    design: PlannedBoard, ideal: IdealAnswer, recording: Recording, noise: OutputNoise | None = None
) -> ErrorBudget:
    """Split the difference of the true stress and the record's end into its parts.

    Parameters
    ----------
    noise : OutputNoise, optional
        Noise of the outputs, if it was computed.

    Raises
    ------
    SolverError
        The problem with the pruned T cannot be solved.
    """
    stress, network = design.problem.stress, design.network
    chain = ErrorChain(None if stress is None else stress * network.U0)
    how = "regularised optimum against the true stress (regularisation and noise)"
    chain.link("ill_posedness", how, ideal.target)
    pruning = pruning_effect(network, design.scene.design.prune, ideal.solution)
    if pruning is not None:
        _pruned(chain, pruning)
    stages = with_ideal_stages(design.circuit)
    plain = design.board if stages is design.circuit else LinearBoard(stages)
    chain.solve(
        "resistors",
        "board as built, with ideal op-amps, against that optimum",
        partial(outputs_at_rest, LinearBoard(with_ideal_opamps(stages))),
        partial(predicted_change, design),
    )
    for link, board in opamp_stages(plain):
        find = partial(outputs_at_rest, board)
        if board is design.board:  # its equilibrium is known
            chain.link(link.name, link.how, find())
        else:
            chain.solve(link.name, link.how, find)
    if plain is not design.board:
        _antilog(chain, design.board)
    _transient(chain, recording)
    if noise is not None:
        chain.parts.append(_noise(noise))
    whole = None
    if chain.first is not None:
        start = "optimum" if stress is None else "true stress"
        whole = difference(
            "total", f"end of the record against the {start}", chain.first, recording.u[-1]
        )
    return ErrorBudget(tuple(chain.parts), whole, chain.solves)


def _pruned(chain: ErrorChain, effect: PruningEffect) -> None:
    bound = effect.bound if math.isfinite(effect.bound) else None
    proven = "no proven bound" if bound is None else f"proven bound {show(bound, 'V', 3)}"
    how = f"optimum without {effect.entries} entries of T against the requested optimum; {proven}"
    chain.link("pruning", how, effect.target, bound=bound)
    chain.solves += 1


def _antilog(chain: ErrorChain, board: LinearBoard) -> None:
    how = (
        "equilibrium with transistors against that with ideal antilog stages; the stages are"
        f" {stage_deviation(board)}"
    )
    chain.link("antilog", how, outputs_at_rest(board))


def _transient(chain: ErrorChain, recording: Recording) -> None:
    """Add what the record's end lacks of the rest, and how far it is from the exact transient."""
    amplitude = recording.measurements.amplitude or 1.0
    error = recording.error.steady_state * amplitude
    bound = error if math.isfinite(error) else None
    if recording.exact_end is None:
        chain.link("unsettled", "end of the record against that equilibrium", recording.u[-1])
        chain.parts.append(ErrorPart("simulator", None, "there is no second solution", bound))
        return
    how = "end of a second transient against that equilibrium"
    chain.link("unsettled", how, recording.exact_end)
    how = "end of the record against that transient"
    if bound is not None:
        small = bound <= LEAST_BOUND * amplitude
        how += f"; error at most {'1 ppb of the step' if small else show(bound, 'V', 3)}"
    chain.link("simulator", how, recording.u[-1], bound=bound)


def _noise(noise: OutputNoise) -> ErrorPart:
    how = "rms at rest over all frequencies: resistors, op-amps and sensors; not in the sum"
    return ErrorPart("noise", noise.known, how)
