"""Margins and stable values of C and of the gain, against closed forms, poles and the onset."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from click.testing import CliRunner

from taction.cli.main import main
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import load_scene
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability import families as module
from taction.verification.stability import margin as margin_module
from taction.verification.stability.edges import Edges, Scan, scan
from taction.verification.stability.margin import Margin, find_margin, stable_values
from taction.verification.stability.poles import Poles, poles
from taction.verification.stability.port_response import PortResponse
from taction.verification.studies.onset import onset
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.run_checks import run_checks
from tests.support.boards import lag_board
from tests.support.measured import evidence, rounded_poles
from tests.support.paths import CASES, SCENES

FILE = SCENES / "tuned-breadboard.toml"
SCENE = load_scene(FILE)


def board(path: str = "name", value: float | str = "tuned") -> Circuit:
    scene = with_values(SCENE, {path: value})
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
    edges = stable_values(board(), knob.removeprefix("C")).edges  # without a name those of C
    crossing = board().value(knob) * (factor if knob == "gain" else 1.0 / factor)
    assert min(abs(edge.value / crossing - 1.0) for edge in edges) < 1e-7


def test_boards_that_differ_in_c_alone_share_their_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    traced, trace = list[float](), module.traced_edges

    def counting(ports: PortResponse, low: float, *more: float) -> Edges:
        traced.append(low)
        return trace(ports, low, *more)

    monkeypatch.setattr(module, "traced_edges", counting)
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
    inside = load_scene(CASES / "margin-window-inside.toml")
    pole = poles(synthesise(inside, make_problem(inside))).rightmost
    assert pole.real == pytest.approx(160.9, rel=1e-3)
    assert find_margin(synthesise(inside, make_problem(inside))).factor == 0.0


@pytest.mark.parametrize("offset", [1e-16, -1e-14])
def test_a_window_within_rounding_is_no_pass(offset: float) -> None:
    margin = find_margin(lag_board(1.5, 8.0 * (1.0 + offset)))
    assert margin.doubt.startswith("at the factor 1.5 a pole is on the imaginary axis to within")
    wanted = evidence(checks={"stability": {"margin": 100}}, margin=margin)
    check = next(each for each in run_checks(wanted) if each.name == "stability")
    assert check.outcome is Outcome.INCONCLUSIVE


def test_where_poles_refute_loci_a_scan_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(margin_module, "_SHARED", {})
    monkeypatch.setattr(Edges, "unstable_at", lambda *_: 7)
    margin = find_margin(board())
    assert margin.doubt == ""
    assert margin.factor == pytest.approx(10e-12 / 4.1337463e-12, rel=1e-7)


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
    asked, find = list[float](), module.Family.poles

    def watched(family: module.Family, value: float) -> Poles:
        asked.append(value / edge)
        return find(family, value)

    monkeypatch.setattr(module.Family, "poles", watched)
    find_margin(quiet)
    assert [value for value in asked if value > 1.1] == [pytest.approx(math.sqrt(40.0), rel=1e-6)]


GRID = np.geomspace(0.1, 10.0, 31).tolist()


def poles_of(*laws: Callable[[float], complex]) -> Callable[[float], Poles]:
    """Poles, rightmost first, from laws in the logarithm of the value; pairs are completed."""

    def read(value: float) -> Poles:
        x = float(np.log(value))
        listed = [complex(law(x)) for law in laws]
        listed += [p.conjugate() for p in listed if p.imag]
        found = np.array(listed)
        return rounded_poles(found)

    return read


def pair(pole: complex) -> Poles:
    return rounded_poles(np.array([pole, np.conj(pole)]))


def places(found: Scan) -> list[float]:
    return [float(np.log(crossing.value)) for crossing in found.edges]


def test_both_ends_of_a_window_far_narrower_than_the_grid_are_found() -> None:
    for half in (1e-2, 1e-3):
        found = scan(GRID, poles_of(lambda x, h=half: h**2 - (x - 0.123) ** 2 + 2j))  # type: ignore[misc]
        assert places(found) == pytest.approx([0.123 - half, 0.123 + half], rel=1e-6)
        assert [c.unstable_above for c in found.edges] == [True, False]
        assert [(c.below, c.above) for c in found.edges] == [(0, 2), (2, 0)]
        assert found.edges[0].frequency == pytest.approx(1.0 / np.pi)
        (low, first), (second, high) = found.stable_ranges
        assert (low, high) == (found.low, found.high) == (0.1, 10.0)
        assert (first, second) == tuple(c.value for c in found.edges)


@pytest.mark.parametrize("start", [GRID[0], GRID[-1]])
def test_from_a_stable_end_nothing_is_read_far_behind_the_first_edge(start: float) -> None:
    """Unstable from 1/e to e, but for a gap near 1 that nobody asks for."""
    seen = list[float]()
    inner = poles_of(lambda x: min(1.0 - x**2, x**2 - 1e-4) + 2j)

    def read(value: float) -> Poles:
        seen.append(value)
        return inner(value)

    sign = 1.0 if start > 1.0 else -1.0
    found = scan(GRID, read, start=start)
    assert places(found) == pytest.approx([sign], rel=1e-6)
    reach = np.log(GRID[1] / GRID[0])
    assert all(sign * np.log(value) >= 1.0 - reach for value in seen)
    whole = scan(GRID, inner)
    assert len(whole.edges) == 4
    assert found.edges[0].value in [pytest.approx(edge.value, rel=1e-7) for edge in whole.edges]


def test_a_stable_gap_inside_an_unstable_range_is_found() -> None:
    found = scan(GRID, poles_of(lambda x: (x + 0.4) ** 2 - 1e-6 + 1j))
    assert places(found) == pytest.approx([-0.401, -0.399], rel=1e-6)
    assert found.stable_ranges == (tuple(c.value for c in found.edges),)


def test_a_mode_that_comes_near_and_turns_back_does_not_cross() -> None:
    found = scan(GRID, poles_of(lambda x: -1e-9 - (x - 0.123) ** 2 + 2j))
    assert found.edges == ()
    assert found.stable_ranges == ((0.1, 10.0),)


def test_crossings_within_one_grid_interval_are_told_apart() -> None:
    found = scan(
        GRID,
        poles_of(
            lambda x: x - 0.01 + 1j,
            lambda x: x - 0.0101 + 2j,
            lambda x: 0.02 - x,
            lambda x: x - 0.03,
        ),
    )
    assert places(found) == pytest.approx([0.01, 0.0101, 0.02, 0.03], rel=1e-6)
    assert [c.unstable_above for c in found.edges] == [True, True, False, True]
    assert [c.frequency > 0.0 for c in found.edges] == [True, True, False, False]
    assert [c.below for c in found.edges] == [1, 3, 5, 4]
    assert [c.changes_stability for c in found.edges] == [False] * 4
    assert found.stable_ranges == ()


def test_a_linear_scan_reaches_zero() -> None:
    found = scan(
        [0.0, 0.5, 1.0],
        lambda v: rounded_poles(np.array([0.3 - v, -5.0], dtype=complex)),
        logarithmic=False,
    )
    assert found.edges[0].value == pytest.approx(0.3, rel=1e-8)
    assert found.stable_ranges == ((found.edges[0].value, 1.0),)


def test_values_without_poles_are_kept_with_their_reason() -> None:
    def read(value: float) -> Poles:
        if value > 2.0:
            raise EngineError("no equilibrium")
        return pair(np.log(value) + 1j)

    found = scan(GRID, read)
    assert places(found) == pytest.approx([0.0], abs=1e-8)
    assert {s.failure for s in found.samples if s.value > 2.0} == {"no equilibrium"}
    with pytest.raises(EngineError, match="no equilibrium"):
        scan([3.0, 4.0], read)


def test_of_incomplete_poles_only_the_rightmost_one_counts() -> None:
    laws = poles_of(lambda x: x - 0.3 + 1j, lambda x: x - 0.4 + 2j, lambda x: x - 0.5)
    found = scan(GRID, lambda v: Poles(laws(v).poles[:3], np.zeros(3), complete=False))
    assert places(found) == pytest.approx([0.3], rel=1e-6)
    assert not found.complete
    assert (found.edges[0].below, found.edges[0].above) == (0, 1)
    assert found.stable_ranges == ((0.1, found.edges[0].value),)


def test_a_window_hidden_behind_a_slower_mode_is_found() -> None:
    """Only between two samples the mode lies right of the mode that is the rightmost at both."""
    window = poles_of(lambda x: 1e-4 - (x - 0.123) ** 2 + 2j, lambda x: -1e-4)
    found = scan(GRID, window)
    assert places(found) == pytest.approx([0.113, 0.133], rel=1e-6)
    assert [(c.below, c.above) for c in found.edges] == [(0, 2), (2, 0)]


def test_a_pole_on_the_axis_to_within_rounding_is_no_crossing_and_no_stable_range(
    rng: np.random.Generator,
) -> None:
    """A pole at 1e6 /s leaves 1.4e-8 /s of rounding to all others."""

    def read(value: float) -> Poles:
        noise = 1e-9 * float(rng.standard_normal())
        drift = 0.0 if value < 1.0 else 1.0 - value
        return rounded_poles(np.array([noise + drift, -1e6], dtype=complex))

    found = scan(GRID, read)
    assert found.edges == ()
    ((low, high),) = found.stable_ranges
    assert low == pytest.approx(1.0, abs=0.1)
    assert high == 10.0
    ((low, high),) = found.unresolved
    assert (low, high) == (0.1, pytest.approx(1.0, abs=0.1))
