"""The catalogue of planted faults: where each is planted, and the checks that fail.

A verdict must not pass with any of them. `caught_by` names checks that fail in that verdict, or
have another `outcome` that is no pass; other checks may fail, too. There is one function for each
station of the pipeline.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.arrays import Wires
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.modes import ModeShares
from taction.verification.readings.readings import Step
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.verdict import run, simulation
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.mutation import planting
from tests.mutation.planting import Plant, figures, scaled, scaled_entry

MATRIX, ELEVEN, TUNED = "custom-matrix", "eleven-channel", "tuned-breadboard"
KNOWN, WIRED = "known-readings", "wired"
PAPER, SKEW = "paper-breadboard", "tangential-exponential"
STATE_SPACE, NGSPICE = "statespace", "ngspice"
STEADY, SETTLES, RISES = "steady_state", "settling_time", "rise_time"
OVERSHOOTS, STABLE, AGREE, SAME = "overshoot", "stability", "engines_agree", "same_problem"


@dataclass(frozen=True)
class Mutation:
    """One planted fault."""

    fault: str  # what is wrong, in words
    where: str  # the station of the pipeline that hands on the wrong value
    plant: Plant
    scene: str  # shipped scene that is verified
    engine: str
    caught_by: tuple[str, ...]  # checks with this outcome
    outcome: Outcome = Outcome.FAIL


def station(
    where: str,
    wrap: Callable[[Any], Plant],
    engine: str = STATE_SPACE,
    more: Outcome = Outcome.FAIL,
) -> Callable[..., Mutation]:
    """Return a function that plants a change at a station, of fault, change, scene and checks."""

    def planted(fault: str, change: Any, scene: str, *caught_by: str) -> Mutation:
        return Mutation(fault, where, wrap(change), scene, engine, caught_by, more)

    return planted


of_problem = station("synthesis", planting.in_the_problem_of_the_board)
of_facts = station("facts of the synthesis", planting.in_the_facts)
of_board = station("circuit (both engines)", planting.in_the_circuit)
of_deck = station("deck", planting.in_the_deck, NGSPICE)
of_text = station("text of the deck", planting.result(simulation, "write_deck"), NGSPICE)
of_run = station("plan of ngspice", planting.in_the_run, NGSPICE)
of_record = station("record of ngspice", planting.in_the_record, NGSPICE)
of_answer = station("answer of the reference", planting.in_the_answer)
of_reference = station(
    "reference",
    lambda change: planting.in_the_answer(lambda a, scene: ideal_answer(change(a.network), scene)),
)
of_equations = station("equations of the state space", planting.in_the_equations, NGSPICE)
of_reduction = station("reduction of the wires", planting.result(Wires, "at_ports"), NGSPICE)
of_modes = station("modes of the state space", planting.result(ModeShares, "amplitudes"), NGSPICE)
of_amplifiers = station(
    "amplifiers of the state space", planting.result(Devices, "outputs"), NGSPICE
)
of_rest = station(
    "equilibrium of the state space",
    lambda change: lambda scene, _: verify(scene, circuit=change(LinearBoard(synthesise(scene)))),
)
# The measures read a changed key of the scene; the limits are those of the right scene.
of_keys = station("measures", lambda change: lambda scene, _: verify(change(scene)))
of_step = station("measures", planting.result(Step, "amplitude"))
measured = planting.result(run, "measure_with_bounds")
of_bounds = station("measures", measured, STATE_SPACE, Outcome.INCONCLUSIVE)
of_baseline = station("baseline", planting.in_the_baseline)


def swap(old: str, new: str) -> Callable[[Deck], Deck]:
    """Return a change of a deck's text."""

    def change(deck: Deck) -> Deck:
        assert old in deck.text
        return replace(deck, text=deck.text.replace(old, new))

    return change


def entry_of(array: str, place: Any, factor: float) -> Callable[[Any], Any]:
    """Return a change of entries of an array of a problem or of a record."""
    return lambda given: replace(
        given, **{array: scaled_entry(getattr(given, array), place, factor)}
    )


def transposed(problem: InverseProblem) -> InverseProblem:
    """Take T for its transpose."""
    assert not np.array_equal(problem.matrix, problem.matrix.T)
    return replace(problem, matrix=problem.matrix.T.copy())


def exchanged(found: Any) -> Any:
    """Swap the first two outputs of a circuit, or the first two columns of a record."""
    if isinstance(found, Circuit):
        first, second, *rest = found.outputs
        return replace(found, outputs=(second, first, *rest))
    return replace(found, values=found.values[:, [1, 0, *range(2, found.values.shape[1])]])


def negated_output(circuit: Circuit) -> Circuit:
    """Read the first output with the wrong sign."""
    first, *rest = circuit.outputs
    return replace(circuit, outputs=(replace(first, sign=-first.sign), *rest))


def without_strongest(shares: np.ndarray) -> np.ndarray:
    """Leave the strongest mode (a conjugate pair has two columns) out of the shares (K, n)."""
    size = np.abs(shares).max(axis=0)
    return np.where(size < 0.999 * size.max(), shares, 0.0)


def at_rest(board: LinearBoard) -> LinearBoard:
    """Return the board with its equilibrium without strain as the equilibrium with strain."""
    return replace(board, point=board.rest)


def stale_target(answer: IdealAnswer, scene: Scene) -> IdealAnswer:
    """Return the answer with the target of twice the lambda, as a wrong cache would."""
    other = ideal_answer(replace(answer.network, lam=2.0 * answer.network.lam), scene)
    return replace(answer, solution=other.solution, target=other.target)


def other_start(answer: IdealAnswer, scene: Scene) -> IdealAnswer:
    """Return the answer for a start from v = 0."""
    return ideal_answer(answer.network, with_values(scene, {"analysis.initial": "zero"}))


# The board is linear; a record begins at 0 V.
STALE = entry_of("values", (slice(1, None), 0), 1.01)
HALF_R, HALF_LAMBDA = {"R": 0.5}, {"lambda": 0.5}
CAPACITORS, STRAYS = ("capacitors", "c_"), ("capacitors", "stray_")
NO_SECOND_POLE = figures(second_pole=math.inf)
OTHER_OPAMP = planting.other_model("c_2", "op27")
OTHER_CORNER = planting.with_other_wires(corner="top-left")
OTHER_STAGE = scaled("amplifiers", "a_", u_scale=1.01)

SYNTHESIS = (
    of_problem("sign of one entry of T", entry_of("matrix", (0, 0), -1.0), MATRIX, STEADY),
    of_problem("one entry of T off by 1 %", entry_of("matrix", (0, 0), 1.01), MATRIX, STEADY),
    of_problem("T taken for its transpose", transposed, SKEW, STEADY),
    of_problem("one strain off by 0.2 %", entry_of("strain", 1, 1.002), ELEVEN, STEADY),
    of_facts("R for twice the lambda; linear, lambda given", HALF_R, MATRIX, STEADY),
    of_facts("R for twice the lambda; exponential", HALF_R, SKEW, STEADY),
    of_facts("half the lambda is stated; linear, lambda given", HALF_LAMBDA, MATRIX, SAME),
    of_facts("U0 off by 1 %", {"U0": 1.01}, SKEW, STEADY, SAME),
    of_facts("Ve off by 1 %", {"Ve": 1.01}, SKEW, SAME),
    of_facts("G0 off by 1 %", {"G0": 1.01}, MATRIX, STEADY),
    of_facts("G0 off by 1 %; inv", {"G0": 1.01}, "inverse", STEADY),
    of_facts("G0 off by 1 %; dead zones", {"G0": 1.01}, "lasso", STEADY),
)
CIRCUIT = (
    of_board("R in kohm", scaled("resistors", "r_", ohms=1e-3), MATRIX, STEADY),
    of_board("C in nF", scaled(*CAPACITORS, farads=1e3), MATRIX, SETTLES),
    of_board("C off by -5 %", scaled(*CAPACITORS, farads=0.95), PAPER, OVERSHOOTS),
    of_board("s off by 0.5 %", scaled("resistors", "s_", ohms=1.005), PAPER, STEADY),
    of_board("C off by 1 %", scaled(*CAPACITORS, farads=1.01), KNOWN, RISES),
    of_board("stray capacitance off by 5 %", scaled(*STRAYS, farads=1.05), KNOWN, SETTLES),
    of_board("gain-bandwidth product off by -5 %", figures(gbw=0.95e6), KNOWN, SETTLES),
    of_board("dropped second pole", NO_SECOND_POLE, KNOWN, SETTLES),
    of_board("wrong op-amp model on one cell", OTHER_OPAMP, KNOWN, SETTLES),
    of_board("swapped op-amp inputs", planting.swapped_inputs("c_1"), MATRIX, STABLE),
    of_board("dropped inverters of w", planting.without_inverters, MATRIX, STEADY),
    of_board("one feedback resistor missing", planting.without_feedback_resistor, MATRIX, STEADY),
    of_board("missing bias", planting.without_bias, SKEW, STEADY),
    of_board("Ve of the stages off by 1 %", scaled("amplifiers", "a_", v_scale=1.01), SKEW, STEADY),
    of_board("U0 of the stages off by 1 %", OTHER_STAGE, SKEW, STEADY),
    of_board("sign of the strain currents", scaled("currents", "eps_", amps=-1.0), MATRIX, STEADY),
    of_board("two outputs swapped", exchanged, MATRIX, STEADY),
    of_board("sign of one output", negated_output, MATRIX, STEADY),
    of_board("wires without their compensation", planting.uncompensated, WIRED, STEADY),
    of_board("word lines of 5 % more", planting.with_other_wires(word_line=63.0), WIRED, STEADY),
)
THIRD_WITNESS = (
    of_deck("C off by 1 %", scaled(*CAPACITORS, farads=1.01), MATRIX, AGREE),
    of_deck("stray capacitance off by 5 %", scaled(*STRAYS, farads=1.05), MATRIX, AGREE),
    of_deck("wrong op-amp model on one cell", OTHER_OPAMP, MATRIX, AGREE),
    of_deck("U0 of the stages off by 1 %", OTHER_STAGE, SKEW, AGREE),
    of_text("one card of a resistor left out", swap("Rz_6_fb", "* Rz_6_fb"), MATRIX, AGREE),
    of_text(
        "Gear's method for the trapezoidal rule", swap("method=trap", "method=gear"), MATRIX, AGREE
    ),
    of_text(
        "start from the operating point in place of 0 V", swap(" uic", ""), MATRIX, AGREE, SAME
    ),
    of_run("start from 0 V in place of rest", {"initial": "zero"}, SKEW, AGREE, SAME),
    of_run("step ten times too large", {"max_step": 10.0, "truncation": 1e3}, MATRIX, AGREE),
    of_record("one stale waveform: of a strain larger by 1 %", STALE, TUNED, AGREE),
    of_record("two channels permuted", exchanged, TUNED, AGREE),
    of_record("time axis longer by 1 %", lambda w: replace(w, time=w.time * 1.01), TUNED, AGREE),
)
FIRST_WITNESS = (
    of_reference("wrong regulariser", lambda n: replace(n, amplifier="tanh"), MATRIX, STEADY),
    of_reference("no bias in the regulariser", lambda n: replace(n, bias=False), SKEW, STEADY),
    of_reference("lambda twice", lambda n: replace(n, lam=2.0 * n.lam), MATRIX, STEADY, SAME),
    of_reference("transposed matrix", lambda n: replace(n, T=n.T.T), SKEW, STEADY),
    of_answer("target of another lambda, from a cache", stale_target, MATRIX, STEADY),
    of_answer("start of another initial state", other_start, SKEW, SAME),
)
SECOND_WITNESS = (
    of_equations("C off by 1 %", scaled(*CAPACITORS, farads=1.01), MATRIX, AGREE),
    of_equations("gain-bandwidth product off by 20 %", figures(gbw=12.9e6), SKEW, AGREE),
    of_equations("ports of an array at another corner", OTHER_CORNER, WIRED, AGREE),
    of_reduction(
        "conductances among the lines of an array left out",
        lambda ports: replace(ports, words=0.0 * ports.words, bits=0.0 * ports.bits),
        WIRED, AGREE,
    ),
    of_reduction(
        "conductances at the ports of an array off by 0.5 %",
        lambda ports: replace(ports, across=1.005 * ports.across), WIRED, AGREE,
    ),
    of_modes(
        "the strongest mode left out of the exact solution", without_strongest, MATRIX,
        AGREE,
    ),
    of_amplifiers(
        "a straight amplifier follows its input 5 % too steeply",
        lambda volts: 1.05 * volts, "lasso", AGREE,
    ),
    of_amplifiers(
        "a saturation limits 5 % too high", lambda volts: 1.05 * volts, "box", AGREE,
    ),
    of_rest("an equilibrium of the wrong branch: without strain", at_rest, TUNED, STEADY),
)  # fmt: skip
READINGS = (
    of_keys(
        "settling band twice as wide",
        lambda s: with_values(s, {"checks.settling_time.band": 0.02}), MATRIX, SETTLES,
    ),
    of_step("step amplitude A twice as large", lambda A: 2.0 * A, MATRIX, SETTLES),
    of_bounds(
        "a dropped uncertainty: 0 for all times", planting.without_uncertainties, MATRIX, SETTLES
    ),
    of_baseline(
        "a stale baseline: made before C changed by 1 %",
        lambda s: with_values(s, {"design.capacitance": "101pF"}), MATRIX, "regression",
    ),
)  # fmt: skip
MUTATIONS = (*SYNTHESIS, *CIRCUIT, *THIRD_WITNESS, *FIRST_WITNESS, *SECOND_WITNESS, *READINGS)
