"""The answer's error against regularised solutions, and what 95 % of the built boards keep."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import draw, parameters, vary
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import load_scene
from taction.system.array_types import Floats
from taction.system.errors import SolverError
from taction.verification.reference.ideal_answer import IdealNetwork
from taction.verification.reference.solve import solve
from taction.verification.report.documents.verdict import budget_parts, verdict_document
from taction.verification.report.views.answer_view import answer_text, yield_text
from taction.verification.verdict import answer_error
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.simulation import build
from taction.verification.verdict.verify import Verdict, verify
from tests.support import nightly
from tests.support.boards import outputs_at_rest
from tests.support.making import make_scene
from tests.support.measured import named
from tests.support.oracle import optimum

T = np.array([[1.0, -0.3, 0.05], [0.2, 0.8, 0.1], [0.0, 0.25, 1.1], [0.4, -0.1, 0.3]])
STRESS = np.array([0.9, 0.3, 0.6])
NOISE = np.array([0.01, -0.02, 0.015, 0.0])
LAM, U0 = 0.2, 0.5
BOARDS, SIGMAS = 1000, 4.0
POOR = {"base": "ideal", "dc_gain": 2e3, "gbw": "10MHz", "output_resistance": "75ohm"}
SLOW = {"base": "ideal", "dc_gain": 1e5, "gbw": "200kHz", "second_pole": "300kHz"}
SQUARE = {"kind": "matrix", "matrix": [[1.0, 0.3], [-0.2, 0.8]], "strain": [0.6, -0.4]}


def judged(
    stress: Floats | None, eps: Floats, times: dict[str, Any] | None = None, **design: Any
) -> Verdict:
    board = {"gain": "100kohm", "unit_conductance": "10uS", "unit_voltage": U0}
    board |= {"capacitance": "470pF", "stray_capacitance": 0, "lambda": LAM, "opamp": POOR}
    checks = {"steady_state": {"tolerance": 0.5}, "settling_time": {"band": 0.1}}
    analysis = {"engine": "statespace", **(times or {})}
    scene = make_scene(design=board | design, analysis=analysis, checks=checks)
    return verify(scene, problem=InverseProblem(T, eps, stress, None))


def assert_split(answer: AnswerError, clean: Floats, noisy: Floats, stress: Floats) -> None:
    """The errors in the channel of the largest, as fractions of the largest true stress."""
    errors, largest = noisy - stress, np.abs(stress).max()
    n = int(np.argmax(np.abs(errors)))
    sign = math.copysign(1.0, errors[n])
    assert answer.true_error == pytest.approx(abs(errors[n]) / largest, rel=1e-9)
    shares = sign * (clean - stress)[n] / largest, sign * (noisy - clean)[n] / largest
    assert answer.regularisation == pytest.approx(shares[0], rel=1e-7)
    assert answer.noise == pytest.approx(shares[1], rel=1e-7, abs=1e-12)
    assert answer.regularisation + answer.noise == pytest.approx(answer.true_error, rel=1e-12)
    assert abs(errors[answer.channel - 1]) == pytest.approx(abs(errors[n]), rel=1e-8)


@pytest.mark.parametrize(
    ("name", "noisy"),
    [("custom-matrix", True), ("eleven-channel", False), ("paper-breadboard", False)],
)
def test_shipped_scenes(name: str, noisy: bool) -> None:
    scene = load_scene(f"scenes/{name}.toml")
    verdict = taction.verify(scene, engine="statespace")
    problem, lam = make_problem(scene), verdict.circuit.value("lambda")
    noisy_u = optimum(problem.matrix, problem.strain, lam)
    clean_u = optimum(problem.matrix, problem.matrix @ problem.stress, lam)
    assert_split(verdict.answer, clean_u, noisy_u, problem.stress)
    assert verdict.answer.has_noise is noisy
    assert (verdict.answer.noise == 0.0) is not noisy


@pytest.mark.parametrize("amplifier", ["exponential", "softplus"])
def test_other_regularisers(amplifier: str) -> None:
    eps = T @ STRESS + NOISE
    verdict = judged(STRESS, eps, amplifier=amplifier, exponential_slope=0.1)
    clean, noisy = (optimum(T, e, LAM, amplifier) for e in (T @ STRESS, eps))
    assert_split(verdict.answer, clean, noisy, STRESS)


@pytest.mark.parametrize("known", [True, False])
def test_the_board_is_compared_in_the_same_unit(known: bool) -> None:
    """Without a true stress the unit is the largest stress of the answer."""
    eps = T @ STRESS + NOISE
    verdict = judged(STRESS if known else None, eps)
    u = optimum(T, eps, LAM)
    unit = U0 * float(np.abs(STRESS if known else u).max())
    assert verdict.answer.unit == pytest.approx(unit, rel=1e-12)
    off = float(np.abs(verdict.steady.values - U0 * u).max())
    assert verdict.answer.board == pytest.approx(off, rel=1e-6)
    found = verdict_document(verdict)["answer"]
    assert found["board_error"] == pytest.approx(off / unit, rel=1e-6)
    assert found["largest_stress"] == pytest.approx(unit, rel=1e-12)
    shares = [found[key] for key in ("true_error", "regularisation", "noise", "channel")]
    assert (None in shares) is not known
    if known:
        assert shares[1] + shares[2] == pytest.approx(shares[0], rel=1e-12)
        assert shares[3] == int(np.argmax(np.abs(u - STRESS))) + 1


def test_the_yield_of_a_pass_is_said_aloud() -> None:
    """One line where most built boards rest beyond the limit, none where they do not."""
    tight = taction.verify("scenes/custom-matrix.toml", engine="statespace")
    assert tight.outcome.value == "pass"
    (line,) = [text for text in str(tight).splitlines() if "passes as drawn" in text]
    assert "of built boards pass: the others rest beyond 0.01 % of the step (resistors 1 %," in line
    assert "op-amp gains 50 %, op-amp input errors; the check counts only the last)" in line
    settings = ["tolerances.resistor=1e-7", "tolerances.opamp_gain=0"]
    loose = taction.verify("scenes/custom-matrix.toml", engine="statespace", settings=settings)
    assert loose.outcome.value == "pass"
    assert "passes as drawn" not in str(loose)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    ("design", "analysis", "name"),
    [
        # 0.6 of stress is 18 V at the supply of 15 V.
        ({"unit_voltage": "30V", "opamp": "op27"}, {}, "headroom"),
        ({}, {"stop": 1e-5, "engine": "ngspice"}, "steady_state"),
        ({"capacitance": "1pF", "opamp": SLOW}, {}, "stability"),
    ],
)
def test_a_board_that_need_not_rest_there_has_no_sentence(
    design: dict[str, Any], analysis: dict[str, Any], name: str
) -> None:
    verdict = judged(STRESS, T @ STRESS, analysis, **design)
    assert named(verdict, name).outcome.value != "pass"
    found = verdict_document(verdict)["answer"]
    assert (found["board_error"], found["text"]) == (None, "")
    largest = np.abs(optimum(T, T @ STRESS, LAM) - STRESS).max() / STRESS.max()
    assert found["true_error"] == pytest.approx(largest, rel=1e-9)


def test_rounding_of_the_strain_is_no_noise() -> None:
    """A strain that was multiplied in another order differs in its last bits."""
    eps = np.array([math.fsum(row * STRESS) for row in T])
    network = IdealNetwork(T, eps * (1.0 + 2.0**-52), LAM, 1e-6)
    found = AnswerError.of(network, solve(network.problem), STRESS)
    assert not found.has_noise
    assert found.noise == 0.0
    louder = replace(network, eps=eps * (1.0 + 1e-12))
    assert AnswerError.of(louder, solve(louder.problem), STRESS).has_noise


def test_a_noiseless_problem_that_cannot_be_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """The distance from the true stress stays; the shares and the split of the budget go."""

    class Unsolved:
        @property
        def rest(self) -> object:
            raise SolverError("no answer")

    def changed(value: Any, **changes: Any) -> object:
        return Unsolved() if "eps" in changes else replace(value, **changes)

    monkeypatch.setattr(answer_error, "replace", changed)
    verdict = judged(STRESS, T @ STRESS + NOISE)
    found = verdict.answer
    assert found.true_error is not None
    assert (found.regularisation, found.noise) == (None, None)
    names = list(budget_parts(verdict.budget))
    assert names[0] == "ill_posedness"
    assert "regularisation" not in names
    assert verdict.budget.summed == pytest.approx(verdict.budget.total.channels, rel=1e-9)


@pytest.mark.parametrize("distribution", ["normal", *nightly("uniform")])
def test_the_sentence_about_the_yield_is_true_of_drawn_boards(distribution: str) -> None:
    """Both numbers that a verdict says of built boards, in the unit of its check."""
    opamp = {"base": "ua741", "input_errors": "typical"}
    design = {"capacitance": "1nF", "lambda": 0.1, "gain": "100kohm", "opamp": opamp}
    scene = make_scene(
        SQUARE,
        design=design | {"unit_conductance": "10uS"},
        tolerances={"resistor": 0.01, "opamp_gain": 0.0, "distribution": distribution},
        checks={"steady_state": {"tolerance": 0.02}, "settling_time": {"band": 0.5}},
        analysis={"engine": "statespace"},
    )
    verdict, circuit = verify(scene), synthesise(scene)
    varied = parameters(circuit, scene.tolerances)
    drawn = (draw(scene.tolerances, varied, 40, k) for k in range(BOARDS))
    rests = [outputs_at_rest(vary(circuit, scene.tolerances, z)) for z in drawn]
    away = np.abs(np.array(rests) - verdict.ideal.target).max(axis=1)
    away /= verdict.measurements.amplitude
    share = float((away <= 0.02).mean())
    said = re.search(r"at most ([\d.]+) % of built boards pass: the others rest beyond 2 %",
                     yield_text(verdict.answer))  # fmt: skip
    assert said is not None
    found, built = verdict_document(verdict)["answer"], verdict.answer.built
    assert built is not None
    assert (found["boards"], found["yield_at_most"]) == (0.95, built.most)
    assert found["built_error"] == pytest.approx(built.distance / verdict.answer.unit)
    assert built.error < 0.1 * built.distance
    beside = SIGMAS * math.sqrt(share * (1.0 - share) / BOARDS)
    assert -beside <= float(said[1]) / 100.0 - share < 0.1 + beside
    wide = re.search(r"95 % of built boards within ([\d.]+) %", answer_text(verdict.answer))
    assert wide is not None
    beside = SIGMAS * math.sqrt(0.95 * 0.05 / BOARDS)
    low, high = np.quantile(away, [0.95 - beside, 0.95 + beside])
    assert low < float(wide[1]) / 100.0 < 1.1 * high  # it rounds up, and has a bound on its error


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
def test_gains_of_op_amps_spread_the_outputs_at_rest(distribution: str) -> None:
    scene = make_scene(
        SQUARE,
        design={"capacitance": "1nF", "lambda": 0.1, "gain": "100kohm", "opamp": POOR},
        tolerances={"resistor": 0.0, "opamp_gain": 0.1, "distribution": distribution},
        analysis={"engine": "statespace"},
    )
    board = build(scene)
    spread = board.built_spread(scene.tolerances)
    varied = parameters(board.circuit, scene.tolerances)
    assert spread is not None
    drawn = (draw(scene.tolerances, varied, 40, k) for k in range(BOARDS))
    rests = [outputs_at_rest(vary(board.circuit, scene.tolerances, z)) for z in drawn]
    near = SIGMAS / math.sqrt(2.0 * BOARDS)
    assert spread.sigma == pytest.approx(np.std(rests, axis=0), rel=near)
