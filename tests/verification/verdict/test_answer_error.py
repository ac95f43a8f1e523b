"""The answer's error and the error budget: every part against a solution that is not taction's."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system import progress
from taction.system.array_types import Floats
from taction.system.errors import EngineError, SolverError
from taction.verification.reference.ideal_answer import IdealNetwork
from taction.verification.reference.solve import solve
from taction.verification.report.blocks import Table
from taction.verification.report.documents.verdict import budget_parts, verdict_document
from taction.verification.report.views.answer_view import answer_text, yield_text
from taction.verification.report.views.verdict_view import budget_table
from taction.verification.verdict import answer_error
from taction.verification.verdict import verify as module
from taction.verification.verdict.answer_error import AnswerError, ErrorBudget
from taction.verification.verdict.verify import Verdict, verify
from tests.support import nightly
from tests.support.boards import sampled
from tests.support.making import make_scene, matrix_problem
from tests.support.measured import named
from tests.support.oracle import optimum

T = np.array([[1.0, -0.3, 0.05], [0.2, 0.8, 0.1], [0.0, 0.25, 1.1], [0.4, -0.1, 0.3]])
STRESS = np.array([0.9, 0.3, 0.6])
EPS = T @ STRESS + np.array([0.01, -0.02, 0.015, 0.0])
LAM, U0, VE = 0.2, 0.5, 0.1
POOR = {"base": "ideal", "dc_gain": 2e3, "gbw": "10MHz", "output_resistance": "75ohm"}
SLOW = {"base": "ideal", "dc_gain": 1e5, "gbw": "200kHz", "second_pole": "300kHz"}
BOARD: dict[str, Any] = {"lambda": LAM, "gain": "100kohm", "unit_conductance": "10uS"}
BOARD |= {"unit_voltage": U0, "capacitance": "470pF", "stray_capacitance": 0, "opamp": POOR}
BOARD |= {"resistor_series": "E96"}
BOARDS, SIGMAS = 1000, 4.0
PRUNE = 0.03  # the two corners of the kernel, 0.0256 of its largest entry


def judged(
    amplifier: str = "linear",
    engine: str = "statespace",
    *,
    known: bool = True,
    problem: InverseProblem | None = None,
    stop: float | None = None,
    **design: Any,
) -> Verdict:
    """The verdict of a board with poor op-amps and rounded resistors."""
    slope = {} if amplifier == "linear" else {"exponential_slope": VE}
    analysis = {"engine": engine, "error": 1e-4} | ({} if stop is None else {"stop": stop})
    checks = {"steady_state": {"tolerance": 0.5}, "settling_time": {"band": 0.1}}
    design = {**BOARD, "amplifier": amplifier, **slope, **design}
    scene = make_scene(design=design, analysis=analysis, checks=checks)
    asked = problem or InverseProblem(T, EPS, STRESS if known else None, None)
    return verify(scene, problem=asked)


def assert_split(answer: AnswerError, clean: Floats, noisy: Floats, stress: Floats) -> None:
    """The errors in the channel of the largest, as fractions of the largest true stress."""
    errors, largest = noisy - stress, np.abs(stress).max()
    n = int(np.argmax(np.abs(errors)))
    sign = math.copysign(1.0, errors[n])
    assert answer.true_error == pytest.approx(abs(errors[n]) / largest, rel=1e-9)
    shares = sign * (clean - stress)[n] / largest, sign * (noisy - clean)[n] / largest
    assert answer.regularisation == pytest.approx(shares[0], rel=1e-7)
    assert answer.noise == pytest.approx(shares[1], rel=1e-7, abs=1e-12)
    assert abs(errors[answer.channel - 1]) == pytest.approx(abs(errors[n]), rel=1e-8)


def assert_unit(verdict: Verdict, best: Floats, known: bool) -> None:
    """The board is compared in the unit of the answer; without a true stress its largest one."""
    unit = float(np.abs(STRESS * U0 if known else best).max())
    off = float(np.abs(verdict.steady.values - best).max())
    assert verdict.answer.board == pytest.approx(off, rel=1e-6)
    found = verdict_document(verdict)["answer"]
    assert found["board_error"] == pytest.approx(off / unit, rel=1e-6)
    assert found["largest_stress"] == pytest.approx(unit, rel=1e-12)
    for key in ("true_error", "regularisation", "noise", "channel"):
        assert found[key] == getattr(verdict.answer, key)
        assert (found[key] is None) is not known


def rounded(circuit: Circuit, amplifier: str) -> tuple[Floats, float]:
    """T and lambda of the resistors of a board, from the formulas of the guide."""
    ohms = {part.name: part.ohms for part in circuit.resistors}
    lam = 1.0 / (ohms["r_1"] * ohms["s_1"] * 1e-5**2)
    if amplifier != "linear":
        lam *= 2.0 * VE / U0
    return circuit.realised, lam


@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("engine", ["statespace", "ngspice"])
def test_the_parts_add_up_and_each_is_right(
    amplifier: str, engine: str, known: bool, request: pytest.FixtureRequest
) -> None:
    if engine == "ngspice":
        request.getfixturevalue("ngspice")
    verdict = judged(amplifier, engine, known=known)
    parts = {part.name: np.array(part.channels) for part in verdict.budget}
    start = ["regularisation", "strain_noise"] if known else ["ill_posedness"]
    assert list(parts) == [*start, "resistors", "opamps", "unsettled", "simulator"]
    best = optimum(T, EPS, LAM, amplifier) * U0
    realised, lam = rounded(verdict.circuit, amplifier)
    built = optimum(realised, EPS, lam, amplifier) * U0
    whole = verdict.u[-1] - (STRESS * U0 if known else best)
    assert verdict.budget.total.channels == pytest.approx(whole.tolist(), abs=1e-9)
    assert np.all(np.abs(np.array(verdict.budget.summed) - whole) <= 0.01 * np.abs(whole))
    if known:
        clean = optimum(T, T @ STRESS, LAM, amplifier) * U0
        assert parts["regularisation"] == pytest.approx(clean - STRESS * U0, abs=1e-9)
        assert parts["strain_noise"] == pytest.approx(best - clean, abs=1e-9)
        assert_split(verdict.answer, clean / U0, best / U0, STRESS)
    assert_unit(verdict, best, known)
    assert parts["resistors"] == pytest.approx(built - best, abs=1e-9)
    assert parts["opamps"] == pytest.approx(verdict.steady.values - built, abs=1e-9)
    assert np.abs(parts["opamps"]).max() > 1e-4
    rest = verdict.u[-1] - verdict.steady.values
    assert parts["unsettled"] + parts["simulator"] == pytest.approx(rest, abs=1e-12)
    assert np.abs(parts["simulator"]).max() < 1e-4


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    ("changes", "name"),
    [
        # 0.6 of stress is 18 V at the supply of 15 V.
        ({"unit_voltage": "30V", "opamp": "op27"}, "headroom"),
        ({"stop": 1e-5, "engine": "ngspice"}, "steady_state"),
        ({"capacitance": "1pF", "opamp": SLOW}, "stability"),
    ],
)
def test_a_board_that_need_not_rest_there_has_no_sentence(
    changes: dict[str, Any], name: str
) -> None:
    verdict = judged(**changes)
    assert named(verdict, name).outcome.value != "pass"
    found = verdict_document(verdict)["answer"]
    assert (found["board_error"], found["text"]) == (None, "")
    largest = np.abs(optimum(T, EPS, LAM) - STRESS).max() / STRESS.max()
    assert found["true_error"] == pytest.approx(largest, rel=1e-9)


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


@pytest.mark.parametrize("distribution", ["normal", *nightly("uniform")])
def test_the_sentence_about_the_yield_is_true_of_drawn_boards(distribution: str) -> None:
    """Both numbers that a verdict says of built boards, in the unit of its check."""
    design = {"capacitance": "1nF", "lambda": 0.1, "gain": "100kohm", "unit_conductance": "10uS"}
    scene = make_scene(
        {"kind": "matrix", "matrix": [[1.0, 0.3], [-0.2, 0.8]], "strain": [0.6, -0.4]},
        design=design | {"opamp": {"base": "ua741", "input_errors": "typical"}},
        tolerances={"resistor": 0.01, "opamp_gain": 0.0, "distribution": distribution},
        checks={"steady_state": {"tolerance": 0.02}, "settling_time": {"band": 0.5}},
        analysis={"engine": "statespace"},
    )
    verdict = verify(scene)
    rests = sampled(verdict.circuit, BOARDS, scene.tolerances)
    away = np.abs(rests - verdict.ideal.target).max(axis=1) / verdict.measurements.amplitude
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
    verdict = judged()
    found = verdict.answer
    assert found.true_error is not None
    assert (found.regularisation, found.noise) == (None, None)
    names = list(budget_parts(verdict.budget))
    assert names[0] == "ill_posedness"
    assert "regularisation" not in names
    assert verdict.budget.summed == pytest.approx(verdict.budget.total.channels, rel=1e-9)


def test_offset_and_input_currents_are_links_of_their_own() -> None:
    """One channel, T = 1, s = 1/G0: against Kirchhoff's law at the three inverting inputs."""
    opamp = {"base": "ideal", "dc_gain": 1e12, "offset_voltage": 1e-3, "bias_current": 1e-9}
    design = {"opamp": opamp | {"input_errors": True}, "resistor_series": "exact"}
    design |= {"inverter_resistance": "10kohm", "unit_voltage": 1.0}
    verdict = judged(problem=matrix_problem([[1.0]], [1.2]), **design)
    parts = {part.name: part for part in verdict.budget}
    assert list(parts)[2:5] == ["opamps", "offset_voltage", "input_currents"]
    causes = {"offset_voltage": (1e-3, 0.0), "input_currents": (0.0, 1e-9)}
    G, Gl, g = 1e-5, LAM * 1e-5, 1e-4
    # Of the outputs u, a, w without strain; each input is at e, and takes the current.
    law = np.array([[g, g, 0.0], [0.0, G, G], [Gl, 0.0, G]])
    for name, (e, current) in causes.items():
        moved = np.linalg.solve(law, e * law.sum(axis=1) + current)[0]
        assert abs(parts[name].channels[0]) == pytest.approx(abs(moved), rel=1e-6)
    assert verdict.budget.summed == pytest.approx(verdict.budget.total.channels, rel=1e-9)


def test_limits_are_a_link_of_their_own() -> None:
    """At the large-signal level the clamps move the rest a little."""
    opamp = {"base": "ua741", "level": "large-signal"}
    design = {"opamp": opamp, "unit_voltage": "4V", "resistor_series": "exact"}
    budget = judged(**design).budget
    parts = {part.name: part for part in budget}
    assert list(parts)[2:5] == ["resistors", "opamps", "limits"]
    assert parts["limits"].value is not None
    assert 0.0 < parts["limits"].value < 1e-3


def test_table_and_document_have_every_part_the_sum_and_the_total() -> None:
    verdict = judged()
    record = verdict_document(verdict)["error_budget"]
    total = record["total"]
    assert total["sum"] == pytest.approx(total["channels"], rel=1e-9)
    added = np.sum([record[part.name]["channels"] for part in verdict.budget], axis=0)
    assert added == pytest.approx(np.array(total["sum"]), rel=1e-12)
    assert record["simulator"]["bound"] > 0.0
    both = np.add(record["regularisation"]["channels"], record["strain_noise"]["channels"])
    whole = verdict.ideal.target - STRESS * U0
    assert record["ill_posedness"]["channels"] == pytest.approx(whole, rel=1e-9)
    assert record["ill_posedness"]["channels"] == pytest.approx(both, rel=1e-12)
    assert record["ill_posedness"]["value"] == pytest.approx(np.abs(whole).max(), rel=1e-9)
    table = budget_table(verdict)
    assert table is not None
    assert isinstance(table, Table)
    assert table.note == "% of the largest true stress, 450 mV."
    place, largest = table.columns.index("of the largest stress"), U0 * np.abs(STRESS).max()
    shares = {row[0].text: row[place].text for row in table.rows}
    assert shares["whole"] == f"{100 * np.abs(total['channels']).max() / largest:.3g} %"


def test_a_budget_that_is_not_known_is_empty_and_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise EngineError("no equilibrium")

    monkeypatch.setattr(progress, "FAILURES", (Exception,))  # as users have it
    monkeypatch.setattr(module, "error_budget", fail)
    verdict = replace(judged())
    assert budget_table(verdict) is None
    assert verdict.warnings[-1].startswith("the error budget failed")
    assert budget_parts(ErrorBudget()) == {}


def scene(prune: float) -> Scene:
    design = {"prune": prune, "lambda": 0.8, "resistor_series": "E96", "unit_voltage": 2.0}
    return make_scene(design=design, analysis={"engine": "statespace"})


def test_the_change_is_measured_beside_its_bound() -> None:
    pruned_scene = scene(PRUNE)
    verdict, problem = taction.verify(pruned_scene), make_problem(pruned_scene)
    T, eps = problem.matrix, problem.strain
    kept = np.where(np.abs(T) < PRUNE * np.abs(T).max(), 0.0, T)
    assert np.count_nonzero(kept != T) == 2
    whole, after = 2.0 * optimum(T, eps, 0.8), 2.0 * optimum(kept, eps, 0.8)
    budget = {part.name: part for part in verdict.budget}
    part = budget["pruning"]
    change = float(np.abs(after - whole).max())
    assert part.value == pytest.approx(change, rel=1e-9)
    assert part.value <= part.bound < part.value * (1.0 + 1e-6)
    assert part.how.startswith("answer without 2 entries of T")
    # The reference keeps the whole T, and the other parts do not contain the pruning.
    assert np.array_equal(verdict.ideal.network.T, T)
    assert verdict.ideal.target == pytest.approx(whole, rel=1e-9)
    rounded = {p.name: p for p in taction.verify(scene(0.0)).budget}["resistors"].value
    assert rounded is not None
    assert budget["resistors"].value == pytest.approx(rounded, rel=0.1)
    record = verdict_document(verdict)["error_budget"]["pruning"]
    assert (record["value"], record["bound"]) == (part.value, part.bound)


# The last row of T has no entry that stays.
WITHOUT_A_ROW = taction.Scene.from_arrays(
    [[2.0, -0.01, 0.0], [0.5, 1.0, 0.019], [0.002, 0.0, -0.015]], [1.0, 2.0, 0.1],
    gain="1Mohm", unit_conductance="10uS", lam=0.5, prune=0.01, engine="statespace",
)  # fmt: skip


def test_a_board_that_loses_a_row_has_a_bound_too() -> None:
    budget = taction.verify(WITHOUT_A_ROW).budget
    (found,) = (part for part in budget if part.name == "pruning")
    assert found.how.startswith("answer without 4 entries of T")
    assert 0.0 < found.value <= found.bound < found.value * (1.0 + 1e-6)
