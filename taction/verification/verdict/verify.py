"""Verify a scene: build its board, simulate it, read the record, judge the readings.

build -> simulate -> read -> judge -> Verdict
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import TypeVar

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene, opamp_words
from taction.system.array_types import Floats, Waveforms
from taction.system.progress import Clock, Progress, attempt
from taction.system.quantities import sizes
from taction.system.results import RENDERERS, Result, load
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.answer_error import (
    AnswerError,
    BuiltBoards,
    ErrorBudget,
    error_budget,
)
from taction.verification.verdict.board import Board
from taction.verification.verdict.checks import Check, Evidence, Outcome, overall
from taction.verification.verdict.details import all_warnings, find_contradiction, missing_witness
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.run import Accuracy, Run, observe
from taction.verification.verdict.run_checks import run_checks
from taction.verification.verdict.simulation import Waiting, begin, build

T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Verdict(Evidence, Result):
    """All results of `verify`; ``print`` shows one screen, `outcome` is the overall result.

    It is the evidence with the checks that follow from it; details are computed when they are read.
    """

    VIEW = "taction.verification.report.views.verdict_view:view"
    SCREEN = "taction.verification.report.views.verdict_view:screen"
    CARD = "Verdict"
    DOCUMENT = "taction.verification.report.documents.verdict:VerdictBody.of"

    run: Run
    checks: tuple[Check, ...]
    timing: dict[str, float]

    @property
    def outcome(self) -> Outcome:
        """The outcome of all checks."""
        return overall(self.checks)

    @property
    def board(self) -> Board:
        """The board, with the plan of the record."""
        return self.run.board

    @property
    def scene(self) -> Scene:
        """The scene, with a number for lambda."""
        return self.board.scene

    @property
    def problem(self) -> InverseProblem:
        """The problem of the scene."""
        return self.board.problem

    @property
    def ideal(self) -> IdealAnswer:
        """The reference solution."""
        return self.board.ideal

    @property
    def circuit(self) -> Circuit:
        """The circuit of the board."""
        return self.board.circuit

    @property
    def transient(self) -> Transient:
        """The transient that was simulated."""
        return self.board.transient

    @property
    def waveforms(self) -> Waveforms:
        """The record, with the remarks of the engine."""
        return self.run.waveforms

    @property
    def u(self) -> Floats:
        """Outputs over time, V, (P, N)."""
        return self.run.u

    @property
    def accuracy(self) -> Accuracy:
        """The error of the transient over all time."""
        return self.run.accuracy

    @cached_property
    def _failures(self) -> list[str]:
        """What could not be found of the details."""
        return []

    def _detail(self, what: str, find: Callable[[], T], otherwise: T) -> T:
        """Return a detail; one that cannot be found is a warning, and the verdict stands."""
        return attempt(what, find, otherwise, self._failures.append)

    @cached_property
    def drawn_answer(self) -> AnswerError:
        """The errors of the answer, and of the board as drawn."""
        ideal, stress = self.ideal, self.problem.stress
        answer = AnswerError.of(ideal.network, ideal.solution, stress, ideal.problem)
        return answer.judged(self, self.checks)

    @cached_property
    def answer(self) -> AnswerError:
        """The errors of the answer, of the board as drawn, and of boards as built."""
        found, board = self.drawn_answer, self.board
        if found.board is None:
            return found
        find = partial(BuiltBoards.of, board, self)
        return replace(found, built=self._detail("the error of built boards", find, None))

    @cached_property
    def budget(self) -> ErrorBudget:
        """The parts of the difference of the record's end and the true stress."""
        find = partial(error_budget, self.run, self, self.answer)
        return self._detail("the error budget", find, ErrorBudget())

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes no check fail, but may be wrong; last the details that are not known."""
        nothing: tuple[str, ...] = ()
        found = self._detail("the warnings", partial(all_warnings, self), nothing)
        _ = self.budget  # it needs the answer: what fails of both is told
        return (*found, *self._failures)

    def __str__(self) -> str:
        page = load(self.SCREEN)(self)
        text: str = load(f"{RENDERERS}.terminal:page_text")(page)
        return text

    def __repr__(self) -> str:
        outcome, circuit = self.outcome.value, self.circuit
        named = [check.name for check in self.checks if check.outcome is self.outcome]
        if self.outcome is not Outcome.PASS:
            outcome += f" ({', '.join(named)})"
        parts = (
            sizes(len(circuit.outputs), len(circuit.constraint_nodes)),
            circuit.values,
            f"op-amp {opamp_words(self.scene.design.opamp)}",
        )
        words = ", ".join(filter(None, parts))
        return f"Verdict({self.scene.name!r}, {outcome}, {self.run.ends.engine}; {words})"


def verify(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
    ideal: IdealAnswer | None = None,
    full_margin: bool = True,
) -> Verdict:
    """Verify a scene: simulate its board, solve its problem, and compare the results.

    `progress` gets the name of each stage. A `problem`, a `circuit` and the answer of the `ideal`
    network are taken in the place of those of the scene. Without `full_margin` the stability margin
    is scanned up to the limit of the scene only.

    InputError: the scene's files or numbers cannot be used.
    NoVerdictError: no engine was found, or the simulation or the reference solution failed.
    """
    clock = Clock(progress)
    board = build(scene, clock, problem=problem, circuit=circuit, ideal=ideal,
                  full_margin=full_margin)  # fmt: skip
    clock.begin("simulation")
    evidence = read(board, begin(board), clock)
    checks = run_checks(evidence)
    clock.end()
    facts = {each.name: getattr(evidence, each.name) for each in fields(Evidence)}
    return Verdict(**facts, checks=checks, timing=clock.seconds)


def read(board: Board, pending: Waiting | None, clock: Clock) -> Evidence:
    """Return all that is judged; what needs no record is computed while the simulation runs."""
    clock.begin("reference")
    ideal, steady, margin = board.ideal, board.steady, board.margin
    parts, noise, spread = board.loads, OutputNoise.of(board), board.spread
    run = observe(board, pending, clock)
    amplitude = run.measured.amplitude or 1.0
    return Evidence(
        limits=board.scene.checks,
        measurements=run.measured,
        end_error=run.error[1] / amplitude,
        steady=steady,
        end=float(run.ends.time[-1]),
        forever=run.own is not None and board.exact is not None,
        wanted=run.board.plan.wanted,
        agreement=run.beside,
        poles=board.poles,
        margin=margin,
        reference_error=ideal.error,
        reference_problem=ideal.problem,
        contradiction=find_contradiction(board.circuit, ideal, run.first_and_last[0]),
        parts=parts,
        noise=noise,
        spread=spread,
        unwitnessed=missing_witness(board.circuit, board.engine),
        run=run,
    )
