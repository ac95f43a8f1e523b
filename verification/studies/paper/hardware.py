"""The second breadboard (exponential amplifiers) and the eleven channels on two chips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from netlist_gen.analysis import OperatingPoint
from netlist_gen.board.circuit import Circuit
from netlist_gen.board.scalings import make_scalings
from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.deck import Deck, write_deck
from netlist_gen.overrides.axes import with_values
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.quantities import show
from spice_models.errors import EngineError
from verification.engines.ngspice.executable import find_simulator
from verification.engines.ngspice.process import simulate
from verification.ideal.ideal_answer import ideal_network
from verification.pipeline.checks import Outcome
from verification.reference import solve
from verification.small_signal.poles import poles
from verification.studies.paper.findings import Chapter, Finding, paper_scene, weigh
from verification.verify import verify

MATRIX = "matrix.inc"
THICKER = 1.2  # depth of the layer that the other matrix chip is for
CLOSE = 1e-3  # of the largest output


def hardware(quick: bool) -> Chapter:
    """Judge the second breadboard, the steady state, and the two-chip partition by ngspice."""
    return Chapter((*_exponential(), _two_chips()))


def _exponential() -> tuple[Finding, Finding]:
    found = verify(paper_scene("paper-exponential"))
    settling = found.measurements.settling_time
    value = float("inf") if settling is None else settling.value
    least = float(found.u[-1].min())
    works = Finding(
        "second-breadboard",
        f"scene paper-exponential, seven channels, {found.waveforms.engine}",
        f"stable, settles in {show(value, 's')}, outputs from {least:.2g} V, all positive; every"
        " check passes",
        weigh(found.outcome is Outcome.PASS and least > 0.0),
        {"settling_time": value, "least_output": least},
    )
    difference = float(np.max(np.abs(found.u[-1] - found.ideal.target)))
    amplitude = found.measurements.amplitude
    rests = Finding(
        "minimum",
        "its final outputs against the minimum of eq (16), found without the circuit",
        f"largest difference {difference / amplitude:.1e} of the step; the minimum's duality gap"
        f" is {found.ideal.solution.certificate:.1e}",
        weigh(difference <= CLOSE * amplitude and found.ideal.solution.trusted),
        {"difference": difference / amplitude},
    )
    return works, rests


def _two_chips() -> Finding:
    thin = paper_scene("eleven-channel")
    thick = with_values(thin, {"problem.depth": THICKER})
    board = synthesise(thin, make_problem(thin))
    wanted = make_problem(thick)
    other = synthesise(thick, wanted)
    deck = _with_matrix_of(replace(board, currents=other.currents), other)
    found = simulate(deck, find_simulator(), timeout=60.0)
    u = [out.sign * float(found[out.node][-1]) for out in board.outputs]
    target = solve(ideal_network(wanted, make_scalings(thick), thick).problem).u
    target = target * thick.design.unit_voltage
    difference = float(np.max(np.abs(u - target)) / np.max(np.abs(target)))
    stable = poles(board).stable and poles(other).stable
    return Finding(
        "two-chips",
        f"deck of depth 1 with the matrix file of depth {THICKER:g}, its sensors' currents,"
        f" operating point by {found.engine}",
        f"largest difference from the other layer's solution {difference:.1e} of the largest"
        f" output; both stable: {'yes' if stable else 'no'}; no amplifier changed",
        weigh(difference <= CLOSE and stable),
        {"difference": difference},
    )


def _with_matrix_of(board: Circuit, other: Circuit) -> Deck:
    """Return the deck of `board` with the matrix file of `other`, its pads in the board's order.

    Raises
    ------
    EngineError
        The other matrix needs a pad that the amplifier chip does not have.
    """
    deck = write_deck(board, OperatingPoint(), solver=find_simulator().solver_option,
                      matrix_file=MATRIX)  # fmt: skip
    swapped = write_deck(other, OperatingPoint(), matrix_file=MATRIX).files[MATRIX]
    own, theirs = (_header(text) for text in (deck.files[MATRIX], swapped))
    missing = set(theirs.split()) - set(own.split())
    if missing:
        raise EngineError(f"the amplifier chip has no pads {', '.join(sorted(missing))}")
    return replace(deck, files={MATRIX: swapped.replace(theirs, own)})


def _header(text: str) -> str:
    """Return the line that names a matrix file's pads."""
    return next(line for line in text.splitlines() if line.startswith(".subckt"))
