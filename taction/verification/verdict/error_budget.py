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
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.wired_arrays import without_wires
from taction.netlist_gen.scene.design import Design
from taction.netlist_gen.topologies.frame.antilog import with_ideal_stages
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.input_spread import InputSpread
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.pruning import pruning_effect
from taction.verification.verdict.recording import Recording


def stage_deviation(board: LinearBoard) -> str:
    """Say how far the antilog stages of a board are from ``U0 exp(v / Ve)``, and at which u.

    They are measured at both ends of their working range: at rest, with and without strain.

    Raises
    ------
    EngineError
        The board has no equilibrium.
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


@dataclass(frozen=True, slots=True)
class OpAmpLink:
    """Figures of an op-amp that make one part of the error budget.

    Attributes
    ----------
    name : str
        Of the part.
    figures : tuple of str
        Fields of `OpAmp`; without these a field has its default, the gain `IDEAL_GAIN`.
    what : str
        The figures in words.
    switch : str
        Field that has to be true for these figures to be in the macromodel, or empty.
    """

    name: str
    figures: tuple[str, ...]
    what: str
    switch: str = ""

    @property
    def how(self) -> str:
        """The comparison that gives the part."""
        return f"{self.what} of the op-amps: equilibrium with against without"

    @property
    def fields(self) -> set[str]:
        """All fields that the link sets."""
        return {*self.figures, *filter(None, [self.switch])}

    def acts_on(self, model: OpAmp) -> bool:
        """Whether the macromodel of `model` has any of the figures."""
        on = not self.switch or getattr(model, self.switch)
        return on and any(getattr(model, name) != _NEUTRAL[name] for name in self.figures)


GAIN = ("dc_gain", "gbw", "second_pole", "input_resistance", "output_resistance", "imported")
CURRENTS = ("bias_current", "offset_current")
LIMITS = ("slew_rate", "saturation", "output_current", "limits_current")
LINKS = (
    OpAmpLink("opamps", GAIN, "finite gain and impedances"),
    OpAmpLink("offset_voltage", ("offset_voltage",), "offset voltage", "input_errors"),
    OpAmpLink("input_currents", CURRENTS, "bias and offset current", "input_errors"),
    OpAmpLink("common_mode", ("common_mode_rejection",), "common-mode rejection", "input_errors"),
    OpAmpLink("limits", LIMITS, "limits", "large_signal"),
)
_NEUTRAL: dict[str, Any] = {f.name: f.default for f in fields(OpAmp)} | {"dc_gain": IDEAL_GAIN}


def with_ideal_opamps(circuit: Circuit) -> Circuit:
    """Return `circuit` with op-amps that add no error at rest."""
    return _with_links(circuit, [])


def opamp_stages(board: LinearBoard) -> Iterator[tuple[OpAmpLink, LinearBoard]]:
    """Yield each link that `board` has, and the board with the figures up to this link.

    The last one is `board` itself. There is none for op-amps without any such figure.
    """
    models = board.circuit.models.values()
    links = [link for link in LINKS if any(map(link.acts_on, models))]
    for count, link in enumerate(links[:-1], 1):
        yield link, LinearBoard(_with_links(board.circuit, links[:count]))
    if links:
        yield links[-1], board


def outputs_at_rest(board: LinearBoard) -> Floats:
    """Return u of every channel at the equilibrium, V, (N,).

    Raises
    ------
    EngineError
        The board has no equilibrium.
    """
    rest = board.equilibrium
    return np.array([output.sign * rest[output.node] for output in board.circuit.outputs])


def _with_links(circuit: Circuit, links: list[OpAmpLink]) -> Circuit:
    """Return `circuit` with the figures of `links` only."""
    kept = set[str]().union(*(link.fields for link in links))
    every = set[str]().union(*(link.fields for link in LINKS))
    absent = {name: _NEUTRAL[name] for name in every - kept}
    models = {name: replace(model, **absent) for name, model in circuit.models.items()}
    return replace(circuit, models=models)


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
    """

    name: str
    value: float | None
    how: str
    bound: float | None = None
    channels: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """The parts, and the whole difference that they add up to.

    Attributes
    ----------
    total : ErrorPart or None
        End of the record less true stress, or less the answer where the stress is not known; None
        for a verification without details.
    """

    parts: tuple[ErrorPart, ...] = ()
    total: ErrorPart | None = None

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
    """

    def __init__(self, first: Floats | None) -> None:
        self.first = self.last = first
        self.parts: list[ErrorPart] = []

    def link(
        self, name: str, how: str, find: Callable[[], Floats] | Floats, bound: float | None = None
    ) -> None:
        """Add the part between the last solution and the next (N,), V; unknown without a last one.

        If the next one cannot be found, the part after it contains this one.
        """
        try:
            u = find() if callable(find) else find
        except EngineError as error:
            self.parts.append(ErrorPart(name, None, f"{how}: {error}"))
            return
        before, self.last = self.last, u
        if before is None:
            self.first = u
            self.parts.append(ErrorPart(name, None, how))
        else:
            self.parts.append(replace(difference(name, how, before, u), bound=bound))


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


def error_budget(
    design: PlannedBoard,
    ideal: IdealAnswer,
    answer: AnswerError,
    recording: Recording,
    noise: OutputNoise | None = None,
    spread: InputSpread | None = None,
) -> ErrorBudget:
    """Split the difference of the true stress and the record's end into its parts.

    Parameters
    ----------
    answer : AnswerError
        The regularised answer beside the true stress, with that without noise.
    noise : OutputNoise, optional
        Noise of the outputs, if it was computed.
    spread : InputSpread, optional
        Where boards of the same parts rest, if they differ.

    Raises
    ------
    SolverError
        The problem with the pruned T cannot be solved.
    """
    chain = ErrorChain(answer.stress)
    _add_answer(chain, design, ideal, answer)
    _add_board(chain, design)
    _transient(chain, recording, LEAST_BOUND * answer.unit)
    if noise is not None:
        how = f"rms at rest {noise.band}: resistors, op-amps and sensors; not in the sum"
        chain.parts.append(ErrorPart("noise", noise.known, how))
    for name, volts in ({} if spread is None else spread.changes).items():
        how = f"95 % of the boards are within, {around(design.scene.design, name)}; not in the sum"
        chain.parts.append(ErrorPart(name, volts, how))
    whole = None
    if chain.first is not None:
        start = "regularised answer" if answer.stress is None else "true stress"
        whole = difference(
            "total", f"end of the record against the {start}", chain.first, recording.u[-1]
        )
    return ErrorBudget(tuple(chain.parts), whole)


def _add_answer(
    chain: ErrorChain, design: PlannedBoard, ideal: IdealAnswer, answer: AnswerError
) -> None:
    """Add what the problem itself has: regularisation, noise of the strain, entries left out."""
    if answer.clean is None:
        how = "regularised answer against the true stress (regularisation and strain noise)"
        chain.link("ill_posedness", how, ideal.target)
    else:
        how = "regularised answer for a strain without noise against the true stress"
        chain.link("regularisation", how, answer.clean)
        noisy = "regularised answer against that without noise"
        how = noisy if answer.has_noise else "the strain is T times the true stress"
        chain.link("strain_noise", how, ideal.target)
    pruning = pruning_effect(design.network, design.scene.design.prune, ideal.solution)
    if pruning is not None:
        bound = pruning.bound if math.isfinite(pruning.bound) else None
        how = f"answer without {pruning.entries} entries of T against the requested answer"
        chain.link("pruning", how, pruning.target, bound)


def _add_board(chain: ErrorChain, design: PlannedBoard) -> None:
    """Add what the board at rest has: resistors, wires, op-amps, stages of transistors."""
    stages = with_ideal_stages(design.circuit)
    plain = design.board if stages is design.circuit else LinearBoard(stages)
    straight = without_wires(stages)
    how = "board as built, with ideal op-amps, against that answer"
    ideal = LinearBoard(with_ideal_opamps(straight))
    chain.link("resistors", how, partial(outputs_at_rest, ideal))
    if straight is not stages:
        how = "wires of the arrays: equilibrium with against without"
        if design.scene.wires.compensate:
            how = f"{how}, after their compensation"
        board = LinearBoard(with_ideal_opamps(stages))
        chain.link("wires", how, partial(outputs_at_rest, board))
    for link, board in opamp_stages(plain):
        chain.link(link.name, link.how, partial(outputs_at_rest, board))
    if plain is not design.board:
        how = (
            "equilibrium with transistors against that with ideal antilog stages; the stages are"
            f" {stage_deviation(design.board)}"
        )
        chain.link("antilog", how, outputs_at_rest(design.board))


def _transient(chain: ErrorChain, recording: Recording, least: float) -> None:
    """Add what the record's end lacks of the rest, and how far it is from the exact transient.

    A bound below `least`, V, has no number.
    """
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
        how += f"; error at most {'1 ppb' if bound <= least else show(bound, 'V', 3)}"
    chain.link("simulator", how, recording.u[-1], bound)
