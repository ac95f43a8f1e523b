"""The error budget: every part against a solution that is not taction's, and the sum of all."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system import progress
from taction.system.array_types import Floats
from taction.system.documents import plain, read
from taction.system.errors import EngineError, SimulationError
from taction.verification.report.blocks import Table
from taction.verification.report.documents.verdict import budget_parts, verdict_document
from taction.verification.report.views.verdict_view import budget_table
from taction.verification.verdict import verify as module
from taction.verification.verdict.answer_error import ErrorBudget
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import (
    ERROR,
    FIGURES,
    Figure,
    Record,
    compare,
    within_uncertainties,
)
from taction.verification.verdict.verify import Verdict, verify
from tests.support.making import make_scene, matrix_problem
from tests.support.oracle import optimum
from tests.support.studying import small_scene

T = np.array([[1.0, -0.3, 0.05], [0.2, 0.8, 0.1], [0.0, 0.25, 1.1], [0.4, -0.1, 0.3]])
STRESS = np.array([0.9, 0.3, 0.6])
EPS = T @ STRESS + np.array([0.01, -0.02, 0.015, 0.0])
LAM, U0, VE = 0.2, 0.5, 0.1
POOR = {"base": "ideal", "dc_gain": 2e3, "gbw": "10MHz", "output_resistance": "75ohm"}
BOARD: dict[str, Any] = {"lambda": LAM, "gain": "100kohm", "unit_conductance": "10uS"}
BOARD |= {"unit_voltage": U0, "capacitance": "470pF", "stray_capacitance": 0, "opamp": POOR}
BOARD |= {"resistor_series": "E96"}
PRUNE = 0.03  # the two corners of the kernel, 0.0256 of its largest entry


def problem(*, known: bool) -> InverseProblem:
    return replace(matrix_problem(T, EPS), stress=STRESS if known else None)


def a_scene(amplifier: str = "linear", engine: str = "statespace", **design: Any) -> Scene:
    slope = {} if amplifier == "linear" else {"exponential_slope": VE}
    design = {**BOARD, "amplifier": amplifier, **slope, **design}
    checks = {"steady_state": {"tolerance": 0.5}, "settling_time": {"band": 0.1}}
    return make_scene(design=design, analysis={"engine": engine, "error": 1e-4}, checks=checks)


def judged(amplifier: str, engine: str = "statespace", *, known: bool = True) -> Verdict:
    return verify(a_scene(amplifier, engine), problem=problem(known=known))


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
    assert parts["resistors"] == pytest.approx(built - best, abs=1e-9)
    assert parts["opamps"] == pytest.approx(verdict.steady.values - built, abs=1e-9)
    assert np.abs(parts["opamps"]).max() > 1e-4
    rest = verdict.u[-1] - verdict.steady.values
    assert parts["unsettled"] + parts["simulator"] == pytest.approx(rest, abs=1e-12)
    assert np.abs(parts["simulator"]).max() < 1e-4


def test_rounding_in_the_passive_topology_has_each_resistor_of_its_own() -> None:
    """There every R_n has another value, and its own rounding."""
    design = {"topology": "passive", "opamp": {"base": "ideal", "dc_gain": 1e9}}
    scene = a_scene(**design, **{"lambda": None, "resistance": "20kohm"})
    verdict = verify(scene, problem=problem(known=False))
    values = {part.name: part.ohms for part in verdict.circuit.resistors}
    assert len({values[f"r_{n}"] for n in (1, 2, 3)}) == 3
    part = next(part for part in verdict.budget if part.name == "resistors")
    # The equations of the network with a conductance of its own for each channel.
    G = verdict.circuit.realised * 1e-5
    load = np.array([1.0 / values[f"r_{n}"] for n in (1, 2, 3)]) + np.abs(G).sum(axis=0)
    s = values["s_1"]
    rest = np.linalg.solve(np.diag(load) + s * G.T @ G, s * G.T @ EPS * 1e-5 * U0)
    built = verdict.ideal.target + np.array(part.channels)
    assert built == pytest.approx(rest, rel=1e-9)


def test_offset_and_input_currents_are_links_of_their_own() -> None:
    """One channel, T = 1, s = 1/G0: against Kirchhoff's law at the three inverting inputs."""
    opamp = {"base": "ideal", "dc_gain": 1e12, "offset_voltage": 1e-3, "bias_current": 1e-9}
    design = {"opamp": opamp | {"input_errors": True}, "resistor_series": "exact"}
    design |= {"inverter_resistance": "10kohm", "unit_voltage": 1.0}
    scene = a_scene(**design)
    verdict = verify(scene, problem=matrix_problem([[1.0]], [1.2]))
    parts = {part.name: part for part in verdict.budget}
    assert list(parts)[2:5] == ["opamps", "offset_voltage", "input_currents"]
    causes = {"offset_voltage": (1e-3, 0.0), "input_currents": (0.0, 1e-9)}
    for name, (volts, amps) in causes.items():
        moved = _moved(volts, amps, lam=LAM, R=1e5, r=1e4)
        assert abs(parts[name].channels[0]) == pytest.approx(abs(moved), rel=1e-6)
    assert verdict.budget.summed == pytest.approx(verdict.budget.total.channels, rel=1e-9)


def _moved(e: float, current: float, *, lam: float, R: float, r: float) -> float:
    """Solve Kirchhoff's law at the three inverting inputs, each at e, for u without strain."""
    G, Gl = 1.0 / R, lam / R
    # Unknowns u, a, w; the current leaves each node into its input.
    A = np.array([[1 / r, 1 / r, 0.0], [0.0, G, G], [Gl, 0.0, G]])
    b = np.array([2 * e / r, 2 * e * G, e * (Gl + G)]) + current
    return float(np.linalg.solve(A, b)[0])


def test_limits_are_a_link_of_their_own() -> None:
    """At the large-signal level the clamps move the rest a little."""
    opamp = {"base": "ua741", "level": "large-signal"}
    design = {"opamp": opamp, "unit_voltage": "4V", "resistor_series": "exact"}
    budget = verify(a_scene(**design), problem=problem(known=True)).budget
    parts = {part.name: part for part in budget}
    assert list(parts)[2:5] == ["resistors", "opamps", "limits"]
    assert parts["limits"].value is not None
    assert 0.0 < parts["limits"].value < 1e-3
    whole = np.array(budget.total.channels) if budget.total else np.zeros(3)
    assert np.all(np.abs(np.array(budget.summed) - whole) <= 0.01 * np.abs(whole))


def test_table_and_document_have_every_part_the_sum_and_the_total() -> None:
    verdict = judged("linear")
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
    verdict = replace(judged("linear"))
    assert budget_table(verdict) is None
    assert verdict.warnings[-1].startswith("the error budget failed")
    assert budget_parts(ErrorBudget()) == {}


def scene(prune: float, amplifier: str = "linear") -> Scene:
    design = {"prune": prune, "amplifier": amplifier, "lambda": 0.8, "resistor_series": "E96"}
    design |= {"unit_voltage": 2.0}
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


@pytest.mark.parametrize(
    ("asked", "entries"),
    [(scene(PRUNE, "exponential"), 2), (scene(PRUNE, "softplus"), 2), (WITHOUT_A_ROW, 4)],
)
def test_other_boards_have_a_bound_too(asked: Scene, entries: int) -> None:
    (found,) = (part for part in taction.verify(asked).budget if part.name == "pruning")
    assert found.how.startswith(f"answer without {entries} entries of T")
    assert 0.0 < found.value <= found.bound < found.value * (1.0 + 1e-6)


def test_a_record_states_what_the_verdict_states_and_leads_back() -> None:
    verdict = verify(small_scene())
    record, settling = Record.of(verdict), verdict.measurements.settling_time
    assert (record.outcome, record.reason, record.failed) == ("pass", "", ())
    assert record.figure("settling_time") == Figure(settling.value, "s", settling.uncertainty)
    assert record.figures.keys() == FIGURES.keys()
    assert record.checks == verdict.checks
    pole = verdict.poles.rightmost
    assert record.pole == pytest.approx((pole.real, abs(pole.imag)), rel=1e-12)
    assert record.engine == "statespace"
    assert record.figure("growth_rate").uncertainty == verdict.poles.resolution
    data = json.loads(json.dumps(plain(record), allow_nan=False))
    assert data["settling_time"] == record.value("settling_time")
    assert data["channels"][0]["reference"] == record.channels[0].figures["reference"]
    assert plain(read(Record, data)) == plain(record)
    with pytest.raises(ValueError, match="outcome"):
        read(Record, {name: value for name, value in data.items() if name != "outcome"})


def test_a_failed_verdict_says_why_and_without_a_verdict_there_is_a_record_too() -> None:
    scene = with_values(small_scene(), {"checks.settling_time.max": 1e-9})
    verdict = verify(scene)
    record = Record.of(verdict)
    assert verdict.outcome is Outcome.FAIL
    assert record.failed == ("settling_time",)
    assert re.fullmatch(r"settles to ±1 % in [\d.]+ [mu]s \(limit: at most 1 ns\)", record.reason)
    record = Record.without_verdict(SimulationError("a"), "ngspice", "x" * 9000)
    assert (record.outcome, record.failure, len(record.reason)) == (ERROR, "SimulationError", 4000)
    assert set(record.figures.values()) == {None}
    assert record.pole is None
    assert read(Record, plain(record)) == record


STABLE = Check("stability", Outcome.PASS, 1.0, 0.125, unit="s")


def make(value: float | None = 1.0, bound: float | None = 0.25, **changes: Any) -> Record:
    bounds = {} if bound is None else {"rise_time": bound}
    record = Record("pass", "statespace", None, figures={"rise_time": value}, uncertainties=bounds)
    return replace(record, checks=(STABLE,), **changes)


FAILED = replace(STABLE, outcome=Outcome.FAIL, value=2.0)
FRAGILE = {"alternatives": {"rise_time": 1.1}}
# A record beside that of 1 s with a bound of 0.25 s: what is compared, and the difference.
COMPARED = [
    (make(1.5), "figures", 1.5, 0.5, 0.5, False),  # both bounds are allowed
    (make(1.51), "figures", 1.51, 0.51, 0.5, True),
    (make(0.4), "figures", 0.4, -0.6, 0.5, True),
    (make(1.0, None), "figures", 1.0, 0.0, None, False),
    (make(1.1, None), "figures", 1.1, 0.1, None, None),  # an unknown bound decides nothing
    (make(None), "figures", None, None, None, True),  # what only one record has
    (make(3.0, **FRAGILE), "figures", 1.1, 0.1, 0.5, False),  # the nearest value counts
    (replace(make(), checks=()), "checks", None, None, None, True),
    (replace(make(), outcome="fail"), "outcome", "fail", None, None, True),
    (replace(make(), checks=(FAILED,)), "checks", "fail", None, None, True),
    (replace(make(), checks=(FAILED,)), "values", 2.0, 1.0, 0.25, True),
]


@pytest.mark.parametrize(("second", "group", "value", "off", "allowed", "beyond"), COMPARED)
def test_what_two_records_differ_by(
    second: Record, group: str, value: Any, off: Any, allowed: Any, beyond: bool | None
) -> None:
    (found,) = compare(make(), second, within_uncertainties, groups=(group,))
    assert (found.second, found.allowed, found.beyond) == (value, allowed, beyond)
    assert found.difference == (None if off is None else pytest.approx(off))
    assert found.unit == ("s" if group in ("figures", "values") else "")
    if group == "figures" and value is not None:
        (back,) = compare(second, make(), within_uncertainties, groups=(group,))
        assert back.first == value


def test_what_no_record_has_is_no_difference_and_two_alternatives_are_not_compared() -> None:
    allowed = within_uncertainties
    assert compare(make(None), make(None), allowed, groups=("figures",)) == ()
    (found,) = compare(make(3.0, **FRAGILE), make(9.0, **FRAGILE), allowed, groups=("figures",))
    assert found.beyond is True
