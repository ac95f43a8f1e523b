"""The catalogue of planted faults: where each is planted, and the checks that fail.

A verdict must not pass with any of them. `caught_by` names checks that fail in that verdict, or
have another `outcome` that is no pass; other checks may fail, too.
"""

from __future__ import annotations

import math
from dataclasses import replace

from taction.netlist_gen.scene.axes import with_value
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.readings.readings import Step
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.verdict.checks import Outcome
from tests.mutation import faults, planting
from tests.mutation.faults import (
    figures,
    scaled,
)
from tests.mutation.mutation import (
    AGREE,
    ELEVEN,
    ENTROPY,
    KNOWN,
    MATRIX,
    NGSPICE,
    OVERSHOOTS,
    PAPER,
    RISES,
    SAME,
    SETTLES,
    SKEW,
    STABLE,
    STATE_SPACE,
    STEADY,
    TUNED,
    Mutation,
    of_answer,
    of_board,
    of_deck,
    of_equations,
    of_facts,
    of_problem,
    of_readings,
    of_record,
    of_reference,
    of_run,
    of_text,
)


def at_rest(board: LinearBoard) -> LinearBoard:
    """Return the board with its equilibrium without strain as the equilibrium with strain."""
    return replace(board, point=board.rest)


def stale_target(answer: IdealAnswer, scene: Scene) -> IdealAnswer:
    """Return the answer with the target of twice the lambda, as a wrong cache would."""
    other = ideal_answer(replace(answer.network, lam=2.0 * answer.network.lam), scene)
    return replace(answer, solution=other.solution, target=other.target)


def other_start(answer: IdealAnswer, scene: Scene) -> IdealAnswer:
    """Return the answer for a start from v = 0."""
    return ideal_answer(answer.network, with_value(scene, "analysis.initial", "zero"))


HALF_R, HALF_LAMBDA = {"R": 0.5}, {"lambda": 0.5}
CAPACITORS, STRAYS = ("capacitors", "c_"), ("capacitors", "stray_")
NO_SECOND_POLE = figures(second_pole=math.inf)
OTHER_OPAMP = faults.other_model("c_2", "op27")
OTHER_STAGE = scaled("amplifiers", "a_", u_scale=1.01)

SYNTHESIS = (
    of_problem("sign of one entry of T", faults.matrix_entry(0, 0, -1.0), MATRIX),
    of_problem("one entry of T off by 1 %", faults.matrix_entry(0, 0, 1.01), MATRIX),
    of_problem("T taken for its transpose", faults.transposed, SKEW),
    of_problem("one strain off by 0.2 %", faults.strain_entry(1, 1.002), ELEVEN),
    of_facts("R for twice the lambda; linear, lambda given", HALF_R, MATRIX, STEADY),
    of_facts("R for twice the lambda; linear, R given", HALF_R, TUNED, STEADY),
    of_facts("R for twice the lambda; exponential", HALF_R, SKEW, STEADY),
    of_facts("half the lambda is stated; linear, lambda given", HALF_LAMBDA, MATRIX, SAME),
    of_facts("half the lambda is stated; linear, R given", HALF_LAMBDA, TUNED, SAME),
    of_facts("half the lambda is stated; exponential, R given", HALF_LAMBDA, ENTROPY, SAME),
    of_facts("U0 off by 1 %", {"U0": 1.01}, SKEW, STEADY, SAME),
    of_facts("Ve off by 1 %", {"Ve": 1.01}, SKEW, SAME),
    of_facts("G0 off by 1 %", {"G0": 1.01}, MATRIX, STEADY),
)
CIRCUIT = (
    of_board("R in kohm", scaled("resistors", "r_", ohms=1e-3), MATRIX, STEADY),
    of_board("C in nF", scaled(*CAPACITORS, farads=1e3), MATRIX, SETTLES),
    of_board("s off by 0.5 %", scaled("resistors", "s_", ohms=1.005), PAPER, STEADY),
    of_board("C off by 8 %", scaled(*CAPACITORS, farads=1.08), PAPER, RISES),
    of_board("C off by -5 %", scaled(*CAPACITORS, farads=0.95), PAPER, OVERSHOOTS),
    of_board("C off by 1 %", scaled(*CAPACITORS, farads=1.01), KNOWN, RISES),
    of_board("C off by -1 %", scaled(*CAPACITORS, farads=0.99), KNOWN, RISES),
    of_board("stray capacitance off by 5 %", scaled(*STRAYS, farads=1.05), KNOWN, SETTLES),
    of_board("stray capacitance off by -5 %", scaled(*STRAYS, farads=0.95), KNOWN, SETTLES),
    of_board("gain-bandwidth product off by 5 %", figures(gbw=1.05e6), KNOWN, RISES),
    of_board("gain-bandwidth product off by -5 %", figures(gbw=0.95e6), KNOWN, SETTLES),
    of_board("dropped second pole", NO_SECOND_POLE, KNOWN, SETTLES),
    of_board("wrong op-amp model on one cell", OTHER_OPAMP, KNOWN, SETTLES),
    of_board("swapped op-amp inputs", faults.swapped_inputs("c_1"), MATRIX, STABLE),
    of_board("dropped inverters of w", faults.without_inverters, MATRIX, STEADY),
    of_board("one feedback resistor missing", faults.without_feedback_resistor, MATRIX, STEADY),
    of_board("missing bias", faults.without_bias, SKEW, STEADY),
    of_board("Ve of the stages off by 1 %", scaled("amplifiers", "a_", v_scale=1.01), SKEW, STEADY),
    of_board("U0 of the stages off by 1 %", OTHER_STAGE, SKEW, STEADY),
    of_board("sign of the strain currents", scaled("currents", "eps_", amps=-1.0), MATRIX, STEADY),
    of_board("one strain current missing", faults.without_current, MATRIX, STEADY),
    of_board("two outputs swapped", faults.swapped_outputs, MATRIX, STEADY),
    of_board("sign of one output", faults.negated_output, MATRIX, STEADY),
)
THIRD_WITNESS = (
    of_deck("C off by 1 %", scaled(*CAPACITORS, farads=1.01), MATRIX),
    of_deck("stray capacitance off by 5 %", scaled(*STRAYS, farads=1.05), MATRIX),
    of_deck("dropped second pole", NO_SECOND_POLE, TUNED),
    of_deck("wrong op-amp model on one cell", OTHER_OPAMP, MATRIX),
    of_deck("dropped inverters of w", faults.without_inverters, MATRIX),
    of_deck("U0 of the stages off by 1 %", OTHER_STAGE, SKEW),
    of_text("Gear's method for the trapezoidal rule", "method=trap", "method=gear", AGREE),
    of_text("start from the operating point in place of 0 V", " uic", "", AGREE, SAME),
    of_run("start from 0 V in place of rest", {"initial": "zero"}, SKEW, AGREE, SAME),
    of_run("step ten times too large", {"max_step": 10.0, "truncation": 1e3}, MATRIX, AGREE),
    of_record("one stale waveform: of a strain larger by 1 %", faults.stale_column(1.01)),
    of_record("two channels permuted", faults.columns([1, 0])),
    of_record("time axis longer by 1 %", faults.stretched_time(1.01)),
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
    of_equations("C off by 1 %", scaled(*CAPACITORS, farads=1.01), MATRIX),
    of_equations("gain-bandwidth product off by 20 %", figures(gbw=4e6), SKEW),
    Mutation(
        "the strongest mode left out of the exact solution",
        "modes of the state space",
        planting.in_a_method(Modes, "amplitudes", faults.without_strongest),
        MATRIX,
        NGSPICE,
        (AGREE,),
    ),
    Mutation(
        "an equilibrium of the wrong branch: without strain",
        "equilibrium of the state space",
        planting.in_the_linearisation(at_rest),
        MATRIX,
        STATE_SPACE,
        (STEADY,),
    ),
)
READINGS = (
    of_readings(
        "settling band twice as wide",
        planting.in_the_scene(lambda s: with_value(s, "checks.settling_time.band", 0.02)),
    ),
    of_readings(
        "step amplitude A twice as large",
        planting.in_a_method(Step, "amplitude", lambda amplitude: 2.0 * amplitude),
    ),
)
CERTAINTY = (
    Mutation(
        "a dropped uncertainty: 0 for all times",
        "measures",
        planting.in_the_measures(faults.without_uncertainties),
        MATRIX,
        STATE_SPACE,
        (SETTLES,),
        Outcome.INCONCLUSIVE,
    ),
    Mutation(
        "a stale baseline: made before C changed by 1 %",
        "baseline",
        planting.in_the_baseline(lambda s: with_value(s, "design.capacitance", "101pF")),
        MATRIX,
        STATE_SPACE,
        ("regression",),
    ),
)
MUTATIONS = (
    *SYNTHESIS,
    *CIRCUIT,
    *THIRD_WITNESS,
    *FIRST_WITNESS,
    *SECOND_WITNESS,
    *READINGS,
    *CERTAINTY,
)
