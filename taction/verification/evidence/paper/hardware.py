"""The second breadboard (exponential amplifiers) and the eleven channels on two chips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.system.errors import EngineError
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import simulate
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    seconds,
    weigh,
)
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.solve import solve
from taction.verification.stability.poles import poles
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify

MATRIX_FILE = "matrix.inc"
THICKER = 1.2  # depth of the layer that the other matrix chip is made for
CLOSE = 1e-3  # of the largest output


def hardware(quick: bool) -> Chapter:
    """Judge the second breadboard, the steady state, and the two-chip partition by ngspice."""
    return Chapter((*_exponential(), _two_chips()))


def _exponential() -> tuple[Finding, Finding]:
    verdict = verify(paper_scene("paper-exponential"))
    final = verdict.u[-1]
    least = float(final.min())
    difference = float(np.max(np.abs(final - verdict.ideal.target)))
    difference /= verdict.measurements.amplitude
    solution = verdict.ideal.solution
    works = finding(
        "second-breadboard",
        {"settling_time": seconds(verdict.measurements.settling_time), "least_output": least},
        weigh(verdict.outcome is Outcome.PASS and least > 0.0),
        simulator=verdict.waveforms.engine,
    )
    outcome = weigh(difference <= CLOSE and solution.trusted)
    return works, finding("minimum", {"difference": difference}, outcome, gap=solution.certificate)


def _two_chips() -> Finding:
    thin = paper_scene("eleven-channel")
    thick = with_values(thin, {"problem.depth": THICKER})
    problem = make_problem(thick)
    thin_board, thick_board = synthesise(thin, make_problem(thin)), synthesise(thick, problem)
    board = replace(thin_board, currents=thick_board.currents)
    record = simulate(_with_matrix_of(board, thick_board), find_simulator(), timeout=60.0)
    u = [out.sign * float(record[out.node][-1]) for out in board.outputs]
    target = solve(ideal_network(problem, thick).problem).u
    target = target * thick.design.unit_voltage
    difference = float(np.max(np.abs(u - target)) / np.max(np.abs(target)))
    stable = poles(thin_board).known_stable and poles(thick_board).known_stable
    return finding(
        "two-chips",
        {"difference": difference},
        weigh(difference <= CLOSE and stable),
        depth=THICKER,
        stable="yes" if stable else "no",
        simulator=record.engine,
    )


def _with_matrix_of(board: Circuit, other: Circuit) -> Deck:
    """Return the deck of `board` with the matrix file of `other`, its pads in the board's order.

    Raises EngineError where the other matrix needs a pad that the amplifier chip does not have.
    """
    deck = write_deck(board, OperatingPoint(), solver=find_simulator().solver_option,
                      matrix_file=MATRIX_FILE)  # fmt: skip
    matrix = write_deck(other, OperatingPoint(), matrix_file=MATRIX_FILE).files[MATRIX_FILE]
    board_header, other_header = (_header(text) for text in (deck.files[MATRIX_FILE], matrix))
    missing = set(other_header.split()) - set(board_header.split())
    if missing:
        raise EngineError(f"the amplifier chip has no pads {', '.join(sorted(missing))}")
    return replace(deck, files={MATRIX_FILE: matrix.replace(other_header, board_header)})


def _header(text: str) -> str:
    """Return the line that names a matrix file's pads."""
    return next(line for line in text.splitlines() if line.startswith(".subckt"))
