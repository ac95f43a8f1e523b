"""The error budget of the outputs: a chain of solutions, whose differences are its parts.

    true stress -> answer without noise -> answer -> pruned T -> resistors as built -> op-amps,
    one link for each group of their figures -> end of the exact transient -> end of the record

Each part is the signed difference of two solutions that follow each other, for every channel, so
the parts add up to the difference of the record's end and the true stress. Noise has no sign: it
stands beside the sum.

The first board between the ideal network and the board as built has ideal op-amps and wires, so
that only its resistors are as built; wires are a link of their own. Each further link gives the
op-amps some more figures, and the last board is the one that is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.wired_arrays import without_wires
from taction.netlist_gen.scene.design import Design
from taction.netlist_gen.topologies.frame.antilog import with_ideal_stages
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.board import Board
from taction.verification.verdict.checks import Evidence
from taction.verification.verdict.input_spread import outputs_at_rest
from taction.verification.verdict.run import Run
from taction.verification.verdict.scene_deck import Pruning


def stage_deviation(board: LinearBoard) -> str:
    """Say how far the antilog stages of a board are from ``U0 exp(v / Ve)``, and at which u.

    They are measured at both ends of their working range: at rest, with and without strain.
    """
    circuit, points = board.circuit, (board.rest, board.equilibrium)
    u = np.array([[out.sign * point[out.node] for out in circuit.outputs] for point in points])
    v = np.array([[point[node] for node in circuit.signal_nodes] for point in points])
    wanted = circuit.value("U0") * np.exp(v / circuit.value("Ve"))
    return (
        f"up to {100.0 * float(np.abs(u / wanted - 1.0).max()):.2g} % from U0 exp(v/Ve), measured"
        f" at u from {show(float(u.min()), 'V', 3)} to {show(float(u.max()), 'V', 3)}"
    )


IDEAL_GAIN = 1e15  # the gain error of a whole board is then at the rounding of its equilibrium
GAIN = ("dc_gain", "gbw", "second_pole", "input_resistance", "output_resistance", "imported")
CURRENTS = ("bias_current", "offset_current")
LIMITS = ("slew_rate", "saturation", "output_current", "limits_current")
OPAMP_LINKS: dict[str, tuple[str, tuple[str, ...], str]] = {
    "opamps": ("finite gain and impedances", GAIN, ""),
    "offset_voltage": ("offset voltage", ("offset_voltage",), "input_errors"),
    "input_currents": ("bias and offset current", CURRENTS, "input_errors"),
    "common_mode": ("common-mode rejection", ("common_mode_rejection",), "input_errors"),
    "limits": ("limits", LIMITS, "large_signal"),
}
"""Parts of the op-amps: words, fields of `OpAmp`, and the field that switches these on."""
_NEUTRAL: dict[str, Any] = {f.name: f.default for f in fields(OpAmp)} | {"dc_gain": IDEAL_GAIN}


def _acts(link: str, model: OpAmp) -> bool:
    """Whether the macromodel of an op-amp has any figure of a link."""
    _, figures, switch = OPAMP_LINKS[link]
    on = not switch or getattr(model, switch)
    return on and any(getattr(model, name) != _NEUTRAL[name] for name in figures)


def _with_links(circuit: Circuit, links: Sequence[str]) -> LinearBoard:
    """Return the board with the figures of some links only; without any its op-amps are ideal."""
    absent = {
        name: _NEUTRAL[name]
        for link, (_, figures, switch) in OPAMP_LINKS.items()
        for name in (*figures, *filter(None, [switch]))
        if not any(name in (*OPAMP_LINKS[kept][1], OPAMP_LINKS[kept][2]) for kept in links)
    }
    models = {name: replace(model, **absent) for name, model in circuit.models.items()}
    return LinearBoard(replace(circuit, models=models))


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """One part: how far it moves the outputs, and the comparison that gives it."""

    name: str
    value: float | None  # largest deviation of any channel, V; None if it cannot be known
    how: str
    bound: float | None = None  # proven bound on the value, V, where there is one
    # Signed deviation of every channel, V; empty for a part that has no sign or is not known.
    channels: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """The parts, and the whole difference that they add up to."""

    parts: tuple[ErrorPart, ...] = ()
    # End of the record less true stress, or less the answer where the stress is not known; None
    # where the parts could not be found.
    total: ErrorPart | None = None

    def __iter__(self) -> Iterator[ErrorPart]:
        """Return an iterator over the parts."""
        return iter(self.parts)

    @property
    def summed(self) -> tuple[float, ...]:
        """Sum of the signed parts of every channel, V."""
        signed = [part.channels for part in self.parts if part.channels]
        return tuple(map(math.fsum, zip(*signed, strict=True)))


class Link(NamedTuple):
    """A solution of the chain: the part it ends, in words, and how to find it, V, (N,)."""

    name: str
    how: str
    solution: Floats | Callable[[], Floats]
    bound: float | None = None  # proven, on the part, V


def chained(first: Floats | None, links: Iterable[Link]) -> Iterator[ErrorPart]:
    """Yield the part between each two solutions that follow each other.

    Without a first solution the first part is not known. Where another solution cannot be found,
    its part is not known, and the part after it contains it.
    """
    last = first
    for name, how, solution, bound in links:
        try:
            u = solution() if callable(solution) else solution
        except EngineError as error:
            yield ErrorPart(name, None, f"{how}: {error}")
            continue
        unknown = ErrorPart(name, None, how)
        yield unknown if last is None else replace(difference(name, how, last, u), bound=bound)
        last = u


def difference(name: str, how: str, before: Floats, after: Floats) -> ErrorPart:
    """Return the part between two solutions (N,), V."""
    apart = after - before
    largest = float(np.max(np.abs(apart), initial=0.0))
    return ErrorPart(name, largest, how, None, tuple(apart.tolist()))


DEVICES = {
    "programming": "as every device is programmed by itself",
    "drift": "as every device drifts by itself",
    "read_noise": "as every device is read by itself",
}
"""Why devices of arrays differ, by the kinds of their spreads."""


def around(design: Design, change: str) -> str:
    """Return where a board must work, as far as a change of its errors depends on it."""
    if change in DEVICES:
        return f"{DEVICES[change]}, to first order"
    if change == "supply_rejection":
        return f"at supplies of ±{design.supply:g} V ± {100.0 * design.supply_tolerance:g} %"
    return f"at {design.temperature}"


LEAST_BOUND = 1e-9  # of the largest stress: a smaller bound on an error has no number of its own


def error_budget(run: Run, evidence: Evidence, answer: AnswerError) -> ErrorBudget:
    """Split the difference of the true stress and the record's end into its parts.

    `answer`: the regularised answer beside the true stress, with that without noise.
    SolverError: the problem with the pruned T cannot be solved.
    """
    board, noise, spread = run.board, evidence.noise, evidence.spread
    error = evidence.error.steady_state * (evidence.measurements.amplitude or 1.0)
    bound, least = error if math.isfinite(error) else None, LEAST_BOUND * answer.unit
    links = (*_of_answer(board, answer), *_of_board(board), *_of_transient(run, bound, least))
    parts = [*chained(answer.stress, links)]
    if run.exact_end is None:
        parts.append(ErrorPart("simulator", None, "there is no second solution", bound))
    if noise is not None:
        how = f"rms at rest {noise.band}: resistors, op-amps and sensors; not in the sum"
        parts.append(ErrorPart("noise", noise.known, how))
    for name, volts in ({} if spread is None else spread.changes).items():
        how = f"95 % of the boards are within, {around(board.scene.design, name)}; not in the sum"
        parts.append(ErrorPart(name, volts, how))
    start = "regularised answer" if answer.stress is None else "true stress"
    first = board.ideal.target if answer.stress is None else answer.stress
    how = f"end of the record against the {start}"
    return ErrorBudget(tuple(parts), difference("total", how, first, run.u[-1]))


def _of_answer(board: Board, answer: AnswerError) -> Iterator[Link]:
    """Yield what the problem itself has: regularisation, noise of the strain, pruned entries."""
    ideal = board.ideal
    if answer.clean is None:
        how = "regularised answer against the true stress (regularisation and strain noise)"
        yield Link("ill_posedness", how, ideal.target)
    else:
        how = "regularised answer for a strain without noise against the true stress"
        yield Link("regularisation", how, answer.clean)
        noisy = "regularised answer against that without noise"
        how = noisy if answer.has_noise else "the strain is T times the true stress"
        yield Link("strain_noise", how, ideal.target)
    pruning = Pruning.of(board.network, board.scene.design.prune, ideal.solution)
    if pruning is not None:
        bound = pruning.bound if math.isfinite(pruning.bound) else None
        how = f"answer without {pruning.entries} entries of T against the requested answer"
        yield Link("pruning", how, pruning.target, bound)


def _of_board(board: Board) -> Iterator[Link]:
    """Yield what the board at rest has: resistors, wires, op-amps, stages of transistors."""

    def link(name: str, how: str, linear: LinearBoard) -> Link:
        return Link(name, how, partial(outputs_at_rest, linear))

    stages = with_ideal_stages(board.circuit)
    straight = without_wires(stages)
    how = "board as built, with ideal op-amps, against that answer"
    yield link("resistors", how, _with_links(straight, ()))
    if straight is not stages:
        how = "wires of the arrays: equilibrium with against without"
        if board.scene.wires.compensate:
            how = f"{how}, after their compensation"
        yield link("wires", how, _with_links(stages, ()))
    models = stages.models.values()
    names = [name for name in OPAMP_LINKS if any(_acts(name, model) for model in models)]
    for count, name in enumerate(names, 1):
        how = f"{OPAMP_LINKS[name][0]} of the op-amps: equilibrium with against without"
        whole = board.linear if stages is board.circuit else LinearBoard(stages)
        yield link(name, how, whole if count == len(names) else _with_links(stages, names[:count]))
    if stages is not board.circuit:
        how = (
            "equilibrium with transistors against that with ideal antilog stages; the stages are"
            f" {stage_deviation(board.linear)}"
        )
        yield link("antilog", how, board.linear)


def _of_transient(run: Run, bound: float | None, least: float) -> Iterator[Link]:
    """Yield what the record's end lacks of the rest, and how far it is from the exact transient.

    `bound`: on the error of the record's end, V; one below `least`, V, has no number.
    """
    if run.exact_end is None:
        yield Link("unsettled", "end of the record against that equilibrium", run.u[-1])
        return
    yield Link("unsettled", "end of a second transient against that equilibrium", run.exact_end)
    how = "end of the record against that transient"
    if bound is not None:
        how += f"; error at most {'1 ppb' if bound <= least else show(bound, 'V', 3)}"
    yield Link("simulator", how, run.u[-1], bound)
