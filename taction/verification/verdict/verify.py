"""Verify a scene: build its board, simulate it, read the record, judge the readings.

build -> simulate -> read -> judge -> Verdict

Beside the checks a verdict has warnings, and whether its witnesses are of one problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.part_warnings import part_warnings, stuck_cells
from taction.netlist_gen.scene.axes import questions
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene, opamp_words
from taction.spice_models.input_errors import not_known
from taction.system.array_types import Floats, Waveforms
from taction.system.documents import taken
from taction.system.progress import Clock, Progress, attempt
from taction.system.quantities import show, sizes, spaced
from taction.system.reading_definitions import READINGS
from taction.system.results import RENDERERS, Result, load
from taction.verification.engines.ngspice.process import missing_simulator
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
    SCREEN = "taction.verification.report.views.answer_view:screen"
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
    return taken(Verdict, evidence, checks=checks, timing=clock.seconds)


def read(board: Board, pending: Waiting | None, clock: Clock) -> Evidence:
    """Return all that is judged; what needs no record is computed while the simulation runs."""
    clock.begin("reference")
    ideal, steady, margin = board.ideal, board.steady, board.margin
    parts, noise, spread = board.loads, board.noise, board.spread
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


FAINTLY = 1e-3  # damping ratio below which a board nearly oscillates
NEARLY = (
    "damping ratio {:.2g}: the board nearly oscillates; component tolerances can make it oscillate"
)
IMPORTED = (
    "op-amp {} is imported: the state-space engine has its cards, linear about their rest, within"
    " {:.2g} % of ngspice's small signal up to {}"
)


def all_warnings(evidence: Evidence) -> tuple[str, ...]:
    """Return the warnings of the scene, the parts, the plan, the engine and the readings."""
    notes, run = list[str](), evidence.run
    if run is not None:
        board, circuit = run.board, run.board.circuit
        rest = board.linear.equilibrium.__getitem__ if board.poles.known_stable else None
        notes += (*questions(board.scene), *run.ends.flags, *board.plan.notes)
        auto = board.scene.analysis.engine == "auto" and board.engine == "statespace"
        if auto and (missing := missing_simulator()):
            notes.append(f"by taction's own engine alone, without ngspice: {missing}")
        notes += (*part_warnings(circuit, rest), *stuck_cells(circuit))
        for name, model in circuit.models.items():
            if model.imported is not None and (linear := model.imported.linear) is not None:
                band = show(linear.band[1], "Hz", 3)
                notes.append(IMPORTED.format(name, 100.0 * linear.error, band))
        notes += not_known(circuit.models.values())
    if not evidence.poles.known_stable:
        return tuple(notes)
    if (damping := evidence.poles.damping_ratio) < FAINTLY:
        notes.append(NEARLY.format(damping))
    for channel in evidence.measurements.channels:
        for name, reading in channel.fragile.items():
            if reading.alternative is not None:
                unit, shifted = READINGS[name].unit, READINGS[name].shifted
                value, other = show(reading.value, unit), show(reading.alternative, unit)
                place = f"channel {channel.index + 1}: {spaced(name)}"
                notes.append(f"{place} {value} is fragile: {other} with {shifted}")
    return tuple(notes)


def missing_witness(circuit: Circuit, engine: str) -> str:
    """Return which of the two witnesses a board with imported op-amps lacks; empty for none."""
    for name, model in circuit.models.items():
        if (imported := model.imported) is None:
            continue
        if imported.linear is None:
            return f"op-amp {name} has no state-space witness: {imported.missing}"
        if engine != "ngspice":
            return f"the slew rate and limits of op-amp {name} are in its netlist: run ngspice"
    return ""


ROUNDED = 1e-9  # relative difference of two formulas for one number; rounding is far below
START = 0.1  # of the step amplitude: rounded resistors move the rest of a board by less
UNSEEN = 1e-12  # V: far below the noise of any board, and above the rounding of a start at 0 V


def find_contradiction(circuit: Circuit, ideal: IdealAnswer, start: Floats) -> str:
    """Return how the board, or the `start` (N,) of its record, V, contradicts the reference.

    Where they differ they are not of the same problem, and the verdict is worth nothing. The starts
    are compared only with a reference whose error is smaller than the step.
    """
    network = ideal.network
    wanted_facts = {"lambda": network.lam, "U0": network.U0, "Ve": network.Ve}
    for name, wanted in wanted_facts.items():
        if name not in circuit.facts:
            continue  # Ve: a linear board has none
        stated = circuit.value(name)
        if not math.isclose(stated, wanted, rel_tol=ROUNDED):
            key = circuit.facts[name].key.rpartition(".")[2]
            return f"the board states {key} = {stated!r}, the reference uses {wanted!r}"
    if ideal.problem or ideal.error >= 1.0:
        return ""
    away = np.abs(start - ideal.start)
    n = int(np.argmax(away))
    if away[n] > max(START * np.abs(ideal.target - ideal.start).max(), UNSEEN):
        here, there = (show(float(u[n]), "V") for u in (start, ideal.start))
        return f"channel {n + 1} starts at {here}, in the reference at {there}"
    return ""
