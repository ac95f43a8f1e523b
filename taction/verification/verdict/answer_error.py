"""How far the regularised answer is from the true stress, and the board from that answer.

    answer - true stress = (answer without noise - true stress) + (answer - answer without noise)

The first part is regularisation, the second is noise; both are stated for the channel in which the
answer is farthest from the true stress. Every distance is a fraction of the largest true stress, or
of the largest stress of the answer where no true stress is known.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, without_wires
from taction.netlist_gen.topologies.frame.planes import with_ideal_stages
from taction.netlist_gen.topologies.frame.topology import pruned
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import EPS, Floats
from taction.system.errors import EngineError, SolverError
from taction.system.quantities import show
from taction.system.results import load
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.reference.ideal_answer import IdealNetwork
from taction.verification.reference.problem import Solution, solution_difference
from taction.verification.verdict.board import Board
from taction.verification.verdict.checks import Check, Evidence, Outcome
from taction.verification.verdict.input_spread import SHARE, outputs_at_rest
from taction.verification.verdict.run import Run
from taction.verification.verdict.run_checks import unconfirmed

DECISIVE = ("headroom", "engines_agree", "same_problem")
"""Checks without which the equilibrium need not be that of the board."""
MOST_SLOPES = 10_000_000  # of outputs with array elements: more would take over 600 MB
ALIKE = 1e-9  # relative difference of errors that count as equal: those of a symmetric board


def worst_channel(errors: Floats) -> int:
    """Return the first channel, from 0, whose error (N,) is the largest but for rounding."""
    sizes = np.abs(errors)
    return int(np.argmax(sizes >= (1.0 - ALIKE) * sizes.max(initial=0.0)))


@dataclass(frozen=True, slots=True)
class BuiltBoards:
    """Where boards of real parts rest, to first order in their deviations."""

    # How far from the regularised answer `SHARE` of the boards keep, V; infinite if not `known`.
    distance: float
    error: float  # bound on the error of `distance`, V
    most: float  # bound on the share that rests within the limits of the scene, and on the yield
    limit: float  # the smaller one of these limits, a fraction of the step amplitude
    varies: str  # what differs between the boards
    counted: str  # what of this the check of the steady state counts

    @property
    def known(self) -> bool:
        """Whether it is known where they rest; it is not for more than `MOST_SLOPES` slopes."""
        return math.isfinite(self.distance)

    @property
    def covers(self) -> str:
        """What differs between the boards, and what of it the check of the steady state counts."""
        if self.counted == self.varies:
            return self.varies
        last = self.counted.count(", ") + 1
        count = f"only the last{f' {last}' * (last > 1)}" if self.counted else "none of these"
        return f"{self.varies}; the check counts {count}"

    @classmethod
    def of(cls, board: Board, evidence: Evidence) -> BuiltBoards | None:
        """Return the boards of a scene; None where nothing varies that moves their rest."""
        checks, amplitude = evidence.limits, evidence.measurements.amplitude
        limit = min(checks.steady_state.tolerance, checks.settling_time.band)
        elements = sum(int(np.isfinite(each.ohms).sum()) for each in board.circuit.matrices)
        if board.scene.tolerances.resistor and elements * len(board.circuit.outputs) > MOST_SLOPES:
            return cls(math.inf, 0.0, 1.0, limit, *board.varies)
        spread = board.built_spread(board.scene.tolerances)
        if spread is None:
            return None
        targets, doubt = evidence.targets, evidence.static_error * amplitude
        distance, error = spread.distance(targets)
        most = spread.within(targets, limit * amplitude)
        return cls(distance, error + doubt, most, limit, *board.varies)


@dataclass(frozen=True, eq=False)
class AnswerError:
    """The errors of an answer, in one unit."""

    DOCUMENT = (
        *("board_error [stress] = shares.board", "board_error_uncertainty [stress] = shares.doubt"),
        "built_error [stress] = shares.built",
        "built_error_uncertainty [stress] = shares.built_doubt",
        "boards = shares.boards # share of the built boards that keep built_error",
        "varies # what differs between the built boards",
        "yield_at_most = built.most # bound by the place of rest alone, to first order",
        *("true_error [stress]", "true_error_uncertainty [stress] = shares.true_doubt"),
        *("regularisation [stress]", "noise [stress]", "channel # from 1"),
        "largest_stress [V] = unit # the true one; if it is not known, that of the answer",
        "text",
    )

    network: IdealNetwork  # the problem that was solved
    target: Floats  # (N,): its regularised answer, V
    target_error: float  # bound on its error, V; infinite where the answer cannot be trusted
    stress: Floats | None  # (N,): the true stress as outputs, V; None where it is not known
    step: float = 0.0  # the step amplitude of the network, V; 0 where the board was not compared
    board: float | None = None  # largest distance of an output at rest from `target`, V
    board_error: float = 0.0  # bound on the error of `board`, V
    built: BuiltBoards | None = None  # None where nothing varies, or `board` is None

    @classmethod
    def of(
        cls, network: IdealNetwork, solution: Solution, stress: Floats | None, doubt: str = ""
    ) -> AnswerError:
        """Return the errors of a solution beside the true `stress` (N,), dimensionless."""
        trusted = solution.trusted and not doubt
        error = solution.error_bound * network.U0 if trusted else math.inf
        known = None if stress is None else stress * network.U0
        return cls(network, solution.u * network.U0, error, known)

    def judged(self, evidence: Evidence, checks: Iterable[Check]) -> AnswerError:
        """Return the errors with the distance of the board.

        There is none for a board that does not come to rest, whose record does not confirm where,
        or where another check doubts that the board is the one that was solved.
        """
        distance, error = evidence.static, evidence.static_error
        if evidence.growth or evidence.obstacle or evidence.unsteady or evidence.unwitnessed:
            return self
        if any(c.name in DECISIVE and c.outcome is not Outcome.PASS for c in checks):
            return self
        if unconfirmed(evidence) or not math.isfinite(distance + error):
            return self
        step = evidence.measurements.amplitude
        return replace(self, step=step, board=distance * step, board_error=error * step)

    @functools.cached_property
    def unit(self) -> float:
        """The voltage of which every error is a fraction, V; 0 if there is no stress at all."""
        return _largest(self.stress) or _largest(self.target)

    @functools.cached_property
    def has_noise(self) -> bool:
        """Whether the strain differs from T times the true stress by more than rounding."""
        if self.stress is None:
            return False
        T, u = self.network.T, self.stress / self.network.U0
        rounding = (len(u) + 4) * EPS * (np.abs(T) @ np.abs(u))
        return bool(np.any(np.abs(self.network.eps - T @ u) > rounding))

    @functools.cached_property
    def clean(self) -> Floats | None:
        """The answer for a strain without noise (N,), V; None if it is not known."""
        if self.stress is None:
            return None
        if not self.has_noise:
            return self.target
        network = self.network
        strain = network.T @ (self.stress / network.U0)
        try:
            solution = replace(network, eps=strain).rest
        except SolverError:
            return None
        return solution.u * network.U0 if solution.trusted else None

    @functools.cached_property
    def channel(self) -> int | None:
        """The channel whose answer is farthest from the true stress, from 1; None: not known."""
        if self.stress is None or math.isinf(self.target_error) or not self.unit:
            return None
        return worst_channel(self.target - self.stress) + 1

    @property
    def text(self) -> str:
        """The errors in a sentence."""
        return str(load("taction.verification.report.views.answer_view:answer_text")(self))

    @property
    def shares(self) -> dict[str, float | None]:
        """Distances and their bounds as fractions of `unit`, and the share of built boards."""
        unit, built = self.unit or math.inf, self.built
        return {
            "board": None if self.board is None else self.board / unit,
            "doubt": None if self.board is None else self.board_error / unit,
            "built": None if built is None else built.distance / unit,
            "built_doubt": None if built is None else built.error / unit,
            "boards": None if built is None else SHARE,
            "true_doubt": None if self.channel is None else self.target_error / unit,
        }

    @property
    def varies(self) -> str:
        """What differs between the built boards; empty if nothing does, or it is not known."""
        return "" if self.built is None else self.built.varies

    @property
    def true_error(self) -> float | None:
        """Largest distance of the answer from the true stress, of `unit`; None: not known."""
        return self._along(self.target, self.stress)

    @property
    def regularisation(self) -> float | None:
        """What regularisation adds to `true_error` in its channel; below 0: it lowers it."""
        return self._along(self.clean, self.stress)

    @property
    def noise(self) -> float | None:
        """What noise of the strain adds to `true_error` in its channel; below 0: it lowers it."""
        return self._along(self.target, self.clean)

    def _along(self, after: Floats | None, before: Floats | None) -> float | None:
        """Return a difference in the worst channel, positive in the direction of the error."""
        if not self.channel or self.stress is None or after is None or before is None:
            return None
        n = self.channel - 1
        sign = -1.0 if self.target[n] < self.stress[n] else 1.0
        return sign * float(after[n] - before[n]) / self.unit + 0.0


def _largest(u: Floats | None) -> float:
    return 0.0 if u is None else float(np.abs(u).max(initial=0.0))


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


def _with_links(circuit: Circuit, links: Sequence[str]) -> LinearBoard:
    """Return the board with the figures of some links only; without any its op-amps are ideal."""
    of_links = {link: {*names, switch} for link, (_, names, switch) in OPAMP_LINKS.items()}
    kept = set[str]().union(*(of_links[link] for link in links))
    absent = {n: _NEUTRAL[n] for n in set().union(*of_links.values()) - kept - {""}}
    models = {name: replace(model, **absent) for name, model in circuit.models.items()}
    return LinearBoard(replace(circuit, models=models))


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """One part: how far it moves the outputs, and the comparison that gives it."""

    name: str
    value: float | None  # largest deviation of any channel, V; None if it cannot be known
    how: str
    bound: float | None = None  # proven bound on the value, V, where there is one
    channels: tuple[float, ...] = ()  # signed deviation of each, V; empty without a sign


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """The parts, and the whole difference that they add up to."""

    parts: tuple[ErrorPart, ...] = ()
    total: ErrorPart | None = None  # record's end less true stress, else less the answer

    def __iter__(self) -> Iterator[ErrorPart]:
        """Return an iterator over the parts."""
        return iter(self.parts)

    @property
    def summed(self) -> tuple[float, ...]:
        """Sum of the signed parts of every channel, V."""
        signed = [part.channels for part in self.parts if part.channels]
        return tuple(map(math.fsum, zip(*signed, strict=True)))


def difference(
    name: str, how: str, before: Floats, after: Floats, bound: float | None = None
) -> ErrorPart:
    """Return the part between two solutions (N,), V."""
    apart = after - before
    largest = float(np.max(np.abs(apart), initial=0.0))
    return ErrorPart(name, largest, how, bound, tuple(apart.tolist()))


Link = tuple[str, str, Floats | LinearBoard, float | None]
"""A solution of the chain, V, (N,), or a board that rests there: the part that it ends, how that is
found, and its proven bound, V."""


def error_budget(run: Run, evidence: Evidence, answer: AnswerError) -> ErrorBudget:
    """Split the difference of the true stress and the record's end into its parts.

    Where a solution cannot be found its part is not known, and the part after it contains it.
    """
    board, noise = run.board, evidence.noise
    error = evidence.end_error * (evidence.measurements.amplitude or 1.0)
    end = error if math.isfinite(error) else None
    parts, last = list[ErrorPart](), answer.stress
    for name, how, solution, bound in _links(run, answer, end):
        try:
            u = outputs_at_rest(solution) if isinstance(solution, LinearBoard) else solution
        except EngineError as reason:
            parts.append(ErrorPart(name, None, f"{how}: {reason}"))
            continue
        found = ErrorPart(name, None, how)
        parts.append(found if last is None else difference(name, how, last, u, bound))
        last = u
    if run.exact_end is None:
        parts.append(ErrorPart("simulator", None, "there is no second solution", end))
    if noise is not None:
        how = f"rms at rest {noise.band}: resistors, op-amps and sensors; not in the sum"
        parts.append(ErrorPart("noise", noise.known, how))
    start = "regularised answer" if answer.stress is None else "true stress"
    first = board.ideal.target if answer.stress is None else answer.stress
    how = f"end of the record against the {start}"
    return ErrorBudget(tuple(parts), difference("total", how, first, run.u[-1]))


def _links(run: Run, answer: AnswerError, end: float | None) -> Iterator[Link]:
    """Yield the chain; the error of the record's end is at most `end`, V."""
    board, ideal = run.board, run.board.ideal
    if answer.clean is None:
        how = "regularised answer against the true stress (regularisation and strain noise)"
        yield "ill_posedness", how, ideal.target, None
    else:
        how = "regularised answer for a strain without noise against the true stress"
        yield "regularisation", how, answer.clean, None
        noisy = "regularised answer against that without noise"
        how = noisy if answer.has_noise else "the strain is T times the true stress"
        yield "strain_noise", how, ideal.target, None
    network = board.network
    kept = pruned(network.T, board.scene.design.prune)
    if entries := int(np.count_nonzero(kept != network.T)):
        after = replace(network, T=kept).rest
        bound = solution_difference(ideal.solution, after)[1] * network.U0
        how = f"answer without {entries} entries of T against the requested answer"
        yield "pruning", how, after.u * network.U0, bound if math.isfinite(bound) else None
    stages = with_ideal_stages(board.circuit)
    straight = without_wires(stages)
    how = "board as built, with ideal op-amps, against that answer"
    yield "resistors", how, _with_links(straight, ()), None
    if straight is not stages:
        how = "wires of the arrays: equilibrium with against without"
        how += ", after their compensation" * board.scene.wires.compensate
        yield "wires", how, _with_links(stages, ()), None
    names = [
        name
        for name, (_, figures, switch) in OPAMP_LINKS.items()
        if any(
            (not switch or getattr(model, switch))
            and any(getattr(model, figure) != _NEUTRAL[figure] for figure in figures)
            for model in stages.models.values()
        )
    ]
    whole = board.linear if stages is board.circuit else LinearBoard(stages)
    for count, name in enumerate(names, 1):
        how = f"{OPAMP_LINKS[name][0]} of the op-amps: equilibrium with against without"
        rest = whole if count == len(names) else _with_links(stages, names[:count])
        yield name, how, rest, None
    if stages is not board.circuit:
        how = "equilibrium with transistors against that with ideal antilog stages"
        yield "antilog", how, board.linear, None
    if run.exact_end is None:
        yield "unsettled", "end of the record against that equilibrium", run.u[-1], None
        return
    yield "unsettled", "end of a second transient against that equilibrium", run.exact_end, None
    how = "end of the record against that transient"
    if end is not None:
        how += f"; error at most {show(end, 'V', 3)}"
    yield "simulator", how, run.u[-1], end
