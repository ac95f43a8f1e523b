"""The error budget of the outputs: a chain of solutions, whose differences are its parts.

    true stress -> optimum -> pruned T -> resistors as built -> op-amps, one link for each group of
    their figures -> end of the exact transient -> end of the record

Each part is the signed difference of two solutions that follow each other, for every channel, so
the parts add up to the difference of the record's end and the true stress. Noise has no sign: it
stands beside the sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from taction.netlist_gen.topologies.frame.antilog import with_ideal_stages
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.error_links import (
    opamp_stages,
    outputs_at_rest,
    predicted_change,
    stage_deviation,
    with_ideal_opamps,
)
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.pruning import PruningEffect, pruning_effect
from taction.verification.verdict.recording import Recording

Predict = Callable[[], Floats | None]


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """One part: how far it moves the outputs, and the comparison that gives it.

    Attributes
    ----------
    value : float or None
        Largest deviation of any channel, V; None if it cannot be known.
    bound : float or None
        Proven bound on the value, V, where there is one.
    channels : tuple of float
        Signed deviation of every channel, V; empty for a part that has no sign or is not known.
    predicted : tuple of float
        The same from first-order sensitivities, where they were computed.
    """

    name: str
    value: float | None
    how: str
    bound: float | None = None
    channels: tuple[float, ...] = ()
    predicted: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """The parts, and the whole difference that they add up to.

    Attributes
    ----------
    total : ErrorPart or None
        End of the record less true stress, or less the optimum where the stress is not known; None
        for a verification without details.
    solves : int
        Solutions that only the budget needed.
    """

    parts: tuple[ErrorPart, ...] = ()
    total: ErrorPart | None = None
    solves: int = 0

    def __iter__(self) -> Iterator[ErrorPart]:
        """Return an iterator over the parts."""
        return iter(self.parts)

    @property
    def summed(self) -> tuple[float, ...]:
        """Sum of the signed parts of every channel, V."""
        signed = [part.channels for part in self.parts if part.channels]
        return tuple(map(math.fsum, zip(*signed, strict=True)))


class ErrorChain:
    """Solutions in the order in which a board moves away from the true stress.

    Attributes
    ----------
    first, last : ndarray (N,) or None
        The first and the latest known solution, V.
    parts : list of ErrorPart
        One for each step of the chain.
    solves : int
        Solutions that `solve` computed.
    """

    def __init__(self, first: Floats | None) -> None:
        self.first = self.last = first
        self.parts: list[ErrorPart] = []
        self.solves = 0

    def link(
        self,
        name: str,
        how: str,
        u: Floats,
        *,
        bound: float | None = None,
        predicted: Floats | None = None,
    ) -> None:
        """Add the part between the last solution and `u` (N,), V; unknown without a last one."""
        before, self.last = self.last, u
        if before is None:
            self.first = u
            self.parts.append(ErrorPart(name, None, how))
            return
        part = difference(name, how, before, u)
        forecast = () if predicted is None else tuple(predicted.tolist())
        self.parts.append(ErrorPart(name, part.value, how, bound, part.channels, forecast))

    def solve(
        self, name: str, how: str, find: Callable[[], Floats], predict: Predict = lambda: None
    ) -> None:
        """Add the part up to the solution of `find`; if that fails, the next part contains it."""
        self.solves += 1
        try:
            u, predicted = find(), predict()
        except EngineError as error:
            self.parts.append(ErrorPart(name, None, f"{how}: {error}"))
            return
        self.solves += predicted is not None
        self.link(name, how, u, predicted=predicted)


def difference(name: str, how: str, before: Floats, after: Floats) -> ErrorPart:
    """Return the part between two solutions (N,), V."""
    apart = after - before
    largest = float(np.max(np.abs(apart), initial=0.0))
    return ErrorPart(name, largest, how, None, tuple(apart.tolist()))


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
