"""Margins and stable values of C and of the gain, against closed forms, poles and the onset."""

from __future__ import annotations

import json
import math

import pytest
from click.testing import CliRunner

from taction.cli.main import main
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_value
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability import edge_search as module
from taction.verification.stability import margin as margin_module
from taction.verification.stability.edges import Edges
from taction.verification.stability.loci import LociSearch
from taction.verification.stability.margin import (
    Margin,
    find_margin,
)
from taction.verification.stability.poles import Poles, poles
from taction.verification.studies.onset.onset import onset
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.run_checks import run_checks
from tests.support.boards import lag_board
from tests.support.measured import evidence
from tests.support.paths import CASES, SCENES

FILE = SCENES / "tuned-breadboard.toml"
SCENE = load_scene(FILE)


def board(path: str = "name", value: float | str = "tuned") -> Circuit:
    scene = with_value(SCENE, path, value)
    return synthesise(scene, make_problem(scene))


@pytest.mark.parametrize(
    ("knob", "factor", "text"),
    [
        ("C", 10e-12 / 4.1337463e-12, "C can shrink by the factor 2.419, to 4.134 pF"),
        ("gain", 4.7034537e6 / 2.3e6, "the gain can grow by the factor 2.045, to 4.703 Mohm"),
    ],
)
def test_a_knob_may_move_to_its_crossing(knob: str, factor: float, text: str) -> None:
    margin = find_margin(board(), knob)
    assert find_margin(board(), knob, found=poles(board())).factor == margin.factor
    assert margin.factor == pytest.approx(factor, rel=1e-7)
    assert margin.uncertainty == pytest.approx(1e-6 * margin.factor)
    assert (margin.text, margin.doubt) == (text, "")


def test_boards_that_differ_in_c_alone_share_their_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    traced, trace = list[LociSearch](), LociSearch.edges

    def counting(search: LociSearch) -> Edges:
        traced.append(search)
        return trace(search)

    monkeypatch.setattr(LociSearch, "edges", counting)
    monkeypatch.setattr(margin_module, "_SHARED", {})
    values = (10e-12, 15e-12, 8e-12, 25e-12)
    boards = [LinearBoard(board("design.capacitance", farads)) for farads in values]
    other = LinearBoard(board("design.gain", "1Mohm"))
    shared, alone = [find_margin(each) for each in boards], find_margin(other)
    assert len(traced) == 3  # of 10 pF alone, of all that follow, of the other gain
    for farads, each, margin in zip(values, boards, shared, strict=True):
        assert isinstance(margin, Margin)
        assert margin.factor == pytest.approx(farads / 4.1337463e-12, rel=1e-7)
        assert margin.factor == pytest.approx(find_margin(each).factor, rel=1e-8)
        assert margin.uncertainty <= 1.1e-6 * margin.factor
    assert alone.factor == pytest.approx(find_margin(other).factor, rel=1e-8)


def test_with_behavioural_amplifiers_the_gain_moves_the_equilibrium() -> None:
    scene = load_scene(SCENES / "paper-exponential.toml")
    margin = find_margin(synthesise(scene, make_problem(scene)), "gain")
    over = "gain=6.5M:7M:3"  # the scene gives R, as the margin keeps it
    (crossing,) = onset(scene, over=over, transients=False).scan.edges
    assert margin.factor * scene.design.gain == pytest.approx(crossing.value, rel=1e-6)
    assert margin.doubt == ""


def test_a_window_between_two_samples_of_the_old_scan_sets_the_margin() -> None:
    """Poles of the deck's text at 200 bits: unstable for C = 1.1153 to 1.2547 nF."""
    scene = load_scene(CASES / "margin-window.toml")
    circuit = synthesise(scene, make_problem(scene))
    margin = find_margin(circuit)
    assert 1.53e-9 / margin.factor == pytest.approx(1.2547e-9, rel=1e-4)
    assert margin.doubt == ""
    found = onset(scene, over="C=15.3pF:1.53nF:3", transients=False)
    low, high = (crossing.value for crossing in found.scan.edges)
    assert low == pytest.approx(1.1153e-9, rel=1e-4)
    assert high == pytest.approx(1.53e-9 / margin.factor, rel=1e-6)
    assert all(count.winding == count.poles for count in found.counts)
    inside = load_scene(CASES / "margin-window-inside.toml")
    pole = poles(synthesise(inside, make_problem(inside))).rightmost
    assert pole.real == pytest.approx(160.9, rel=1e-3)
    assert find_margin(synthesise(inside, make_problem(inside))).factor == 0.0


@pytest.mark.parametrize("offset", [1e-16, -1e-14])
def test_a_window_within_rounding_is_no_pass(offset: float) -> None:
    margin = find_margin(lag_board(1.5, 8.0 * (1.0 + offset)))
    assert margin.doubt == "at the factor 1.5 a pole is on the imaginary axis to within rounding"
    wanted = evidence(checks={"stability": {"margin": 100}}, margin=margin)
    check = next(each for each in run_checks(wanted) if each.name == "stability")
    assert check.outcome is Outcome.INCONCLUSIVE


def test_poles_and_winding_numbers_that_differ_leave_a_doubt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where poles refute the loci, or there are none, a scan and winding numbers must agree."""
    monkeypatch.setattr(Edges, "unstable_at", lambda *_: 7)
    assert find_margin(board()).doubt == ""
    monkeypatch.setattr(margin_module, "count_unstable", lambda _: 0)
    margin = find_margin(board())
    assert margin.factor == pytest.approx(10e-12 / 4.1337463e-12, rel=1e-7)
    assert margin.doubt.endswith("2 poles are unstable and the winding number is 0")


def test_verify_reports_both_margins_when_asked() -> None:
    arguments = ["verify", str(FILE), "--engine", "statespace", "--json"]
    runner = CliRunner()
    found = json.loads(runner.invoke(main, [*arguments, "--margins"]).stdout)["stability"]
    assert found["margins"]["capacitance"]["factor"] == pytest.approx(2.41911, rel=1e-5)
    assert found["margins"]["gain"]["factor"] == pytest.approx(2.04498, rel=1e-5)
    assert found["margins"]["gain"]["doubt"] == ""
    assert "margins" not in json.loads(runner.invoke(main, arguments).stdout)["stability"]


def test_poles_find_a_window_that_the_loci_miss(monkeypatch: pytest.MonkeyPatch) -> None:
    """Poles are asked between a board and an edge that is farther than a factor of 30."""
    monkeypatch.setattr(margin_module, "_SHARED", {})
    edge = 4.1337463e-12
    quiet = board("design.capacitance", 40 * edge)
    assert find_margin(quiet).factor == pytest.approx(40.0, rel=1e-6)
    asked, find = list[float](), module.brief_poles

    def watched(board: LinearBoard) -> Poles:
        asked.append(board.circuit.value("C") / edge)
        return find(board)

    monkeypatch.setattr(module, "brief_poles", watched)
    find_margin(quiet)
    assert [value for value in asked if value > 1.1] == [pytest.approx(math.sqrt(40.0), rel=1e-6)]
