"""The decks that taction writes, read back, are the boards that it wrote; what is asked of decks.

Worst cases, yield and a reference: against closed forms and the regularised optimum.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy import constants
from scipy.optimize import brentq

import taction
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.netlist_gen.topologies.frame.topology import TOPOLOGIES
from taction.system import documents
from taction.system.errors import EngineError, InputError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.readings.exact_measures import ExactResponse
from taction.verification.readings.readings import Reading
from taction.verification.report.documents import document_catalogue
from taction.verification.stability.edges import Edge
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.board_check import BoardCheck
from taction.verification.studies.decks.foreign_board import read_board
from taction.verification.studies.decks.measured_board import (
    MeasuredBoard,
    PartRow,
    beside,
    measure_board,
)
from taction.verification.studies.decks.questions import QUESTIONS, Question
from tests.support.designer_decks import written
from tests.support.running import taction as command

READABLE = ("ngspice", "ltspice", "hspice")  # the dialects that ngspice can read
SMALL = {
    "base": "ideal", "dc_gain": 1e5, "gbw": "1MHz", "second_pole": "2.5MHz",
    "output_resistance": "75ohm", "input_capacitance": "3pF",
}  # fmt: skip
DIVIDER = "V1 in 0 PULSE(0 4)\nR1 in out 1k\nR2 out 0 3k\nC1 out 0 1n"
RC = "V1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n"
PULSED = "V1 in 0 PULSE(0 2)\nR1 in out 1k\nR2 out 0 1k\nC1 out 0 1n"
TRANSFORMER = (
    ".param k=0\nV1 in 0 PULSE(0 1)\nR1 in a 1k\nL1 a 0 1m\nL2 out 0 1m\nK1 L1 L2 0.9\n"
    "R2 out 0 {1k+k}"
)
TAU, SLOW = 1e-6, 1.01 * 1.05 * 1e-6
WORST = [
    # With R and C at their upper ends tau is 1.01 * 1.05 times its value.
    (RC, "resistor = 0.01\ncapacitor = 0.05\n", "growth_rate", -1.0 / SLOW),
    (RC, "resistor = 0.01\ncapacitor = 0.05\n", "settling_time", SLOW * math.log(100.0)),
    (RC, "resistor = 0.01\ncapacitor = 0.05\n", "rise_time", SLOW * math.log(9.0)),
    # A divider of 2 V, in steps of 1 V: twice the share.
    (PULSED, 'resistor = "1%"\n', "steady_state", 2.0 * (1.01 / (1.01 + 1.0 / 1.01) - 0.5)),
    # Behind R1 the leakage L (1 - k^2) of equal coils decays through R2 + R1 fastest:
    # (R1 + s L)(R2 + s L) = (s M)^2 with R1 = R2, so s = -R / (L (1 + k)), the slower one
    (TRANSFORMER, "coupling = 0.05\n", "growth_rate", -1e6 / (1.0 + 0.9 * 1.05)),
]
T, EPS = np.array([[2.0, 1.0], [1.0, 3.0], [0.0, 1.0]]), np.array([3.0, 4.0, 2.0])

pytestmark = pytest.mark.usefixtures("ngspice")


@pytest.mark.parametrize("dialect", READABLE)
@pytest.mark.parametrize(
    ("name", "topology"),
    [*(("", each) for each in sorted(TOPOLOGIES)), ("known-readings", ""), ("custom-matrix", "")],
)
def test_a_deck_read_back_has_the_poles_and_readings_of_its_board(
    name: str, topology: str, dialect: str, tmp_path: Path
) -> None:
    if name:
        scene = taction.load_scene(f"scenes/{name}.toml")
    else:
        matrix = [[1.0, 0.4, 0.1], [0.4, 1.0, -0.4], [0.1, -0.4, 1.0]]
        scene = taction.Scene.from_arrays(
            matrix, [0.4, 0.2, 0.1], topology=topology, unit_conductance="2uS", opamp=SMALL,
            feedback_conductance="20uS",
            **({} if topology in ("inv", "pinv") else {"lam": 5.0}),
        )  # fmt: skip
    deck = taction.netlist(scene, dialect=dialect)
    place = tmp_path / "board.cir"
    place.write_text(deck.text)
    board = read_board(place)
    assert board.initial == deck.analysis.initial
    assert [out.node for out in board.circuit.outputs] == [out.node for out in deck.circuit.outputs]
    one, other = (poles(LinearBoard(each)).poles for each in (deck.circuit, board.circuit))
    for part in (np.real, np.abs):
        np.testing.assert_allclose(np.sort(part(other)), np.sort(part(one)), rtol=1e-9)
    found = taction.diff(scene, place)
    assert found.exit_status == 0, found
    assert {each.name for each in found.readings} >= {"equilibrium", "rise_time", "overshoot"}


@pytest.mark.nightly  # margins of 150 parts: a minute of processor time
def test_a_real_pole_that_crosses_beyond_a_margin_is_known(tmp_path: Path) -> None:
    """The margin is 3.27; det(-K) in rational numbers changes its sign at 22.70 to 22.72 Rf_2_2."""
    place = tmp_path / "board.cir"
    place.write_text(taction.netlist("scenes/tuned-breadboard.toml").text)
    found = taction.check(place, checks="margin=2", ngspice=False)
    assert found.outcome.value == "pass"
    (check,) = found.checks
    assert check.value == pytest.approx(3.269, rel=1e-3)
    (row,) = (row for row in found.parts if row.name == "Rf_2_2")
    assert row.above is not None
    assert 22.70 < row.above / row.value < 22.72
    assert not any(row.doubt for row in found.parts)


def test_a_part_between_one_node_and_itself_moves_nothing(tmp_path: Path) -> None:
    parts = "R1 in out 1k\nC1 out 0 1n\nR5 0 0 1k\nC5 0 0 1n\nR6 out out 2k"
    place = written(tmp_path, f"V1 in 0 PULSE(0 1)\n{parts}")
    found = taction.check(place, checks="margin=2", ngspice=False)
    assert found.outcome.value == "pass"
    rates = {row.name: row.real for row in found.parts}
    assert rates == {"R1": pytest.approx(1e6), "C1": pytest.approx(1e6), "R5": 0, "C5": 0, "R6": 0}


@pytest.mark.parametrize(("sure", "doubt"), [(1.5, "R1: a pole comes close"), (9.0, "")])
def test_a_doubt_counts_within_the_margin_only(sure: float, doubt: str) -> None:
    """A loop gain of 2 at R1/R2 = 1: the edge is at R2 of twice its value."""
    cards = ["v1 in 0 1", "r1 in a 1e3", "c1 a 0 1e-9", "g1 0 a a 0 5e-4", "r2 a 0 1e6"]
    board = LinearBoard(circuit_of(read_cards(cards), "negative", ["a"]))
    edge = Edge(2.002, 0.0, 0, 1, 1e-9)  # over the factor of the part
    surely = PartRow("G1", 5e-4, "S", 0.0, 0.0, edges=(edge,))
    doubtful = PartRow("R1", 1e3, "ohm", 0.0, 0.0, doubt="a pole comes close", sure=sure)
    found = measure_board(board, "rest", 0.01, every=True)
    vars(found)["parts"] = (surely, doubtful)
    least = found.margin
    assert least.factor == pytest.approx(2.002, rel=1e-6)
    assert least.doubt == doubt


def test_the_edges_of_a_negative_value_are_in_the_order_of_values() -> None:
    edges = Edge(0.5, 0.0, 0, 1), Edge(2.0, 0.0, 0, 1)
    assert beside(10.0, edges) == (5.0, 20.0)
    assert beside(-10.0, edges) == (-20.0, -5.0)


def test_an_output_that_returns_settles_in_shares_of_its_exact_peak(tmp_path: Path) -> None:
    """A parallel resonator of quality 100: peak and settling time in closed form."""
    ohms, henry, farads = 1e5, 1e-2, 1e-8
    decay = 0.5 / (ohms * farads)
    turn = math.sqrt(1.0 / (henry * farads) - decay**2)
    cards = f"R1 in out {ohms!r}\nL1 out 0 {henry!r}\nC1 out 0 {farads!r}"
    deck = written(tmp_path, f"V1 in 0 PULSE(0 1)\n{cards}")
    found = taction.check(deck, outputs=["out"], ngspice=False).measurements

    def volts(t: float) -> float:
        return math.exp(-decay * t) * math.sin(turn * t) / (ohms * farads * turn)

    first = math.atan2(turn, decay) / turn  # later peaks follow after half periods
    assert found.amplitude == pytest.approx(volts(first), rel=1e-13)
    level, half = found.band * volts(first), math.pi / turn
    last = max(n for n in range(1000) if abs(volts(first + n * half)) > level)
    ends = first + last * half, (last + 1) * half
    true = brentq(lambda t: abs(volts(t)) - level, *ends, xtol=1e-18, rtol=1e-15)
    reading = found.settling_time
    assert reading is not None
    assert abs(reading.value - true) <= reading.uncertainty + 1e-15 * true
    # With -R1 it grows, and is compared by the size at the end of what is looked at.
    growing = f"{cards.replace(repr(ohms), repr(-ohms))}\nE1 x 0 out 0 -2"
    board = taction.check(
        written(tmp_path, f"V1 in 0 PULSE(0 1)\n{growing}"), outputs=["out", "x"], ngspice=False
    )
    size = 2.0 * math.exp(decay * board.scales.stop) / (ohms * farads * turn)
    assert board.measurements.amplitude == pytest.approx(size, rel=0.03)


def test_an_output_without_known_noise_leaves_those_of_the_others(tmp_path: Path) -> None:
    """White noise of a divider without a capacitor has no limit; beside 1 nF it is kT/C."""
    cards = "R1 in a 1k\nR2 a 0 1k\nR3 in out 1k\nC1 out 0 1n\n.print v(a) v(out)"
    noise = taction.check(written(tmp_path, f"V1 in 0 PULSE(0 1)\n{cards}"), ngspice=False).noise
    volts = math.nan, math.sqrt(constants.k * 300.15 / 1e-9)
    assert noise.rms == pytest.approx(volts, rel=1e-12, nan_ok=True)
    assert noise.unknown.startswith("a: the noise has no limit")


@pytest.fixture
def deck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A deck, while there is one more question; documents are made anew before and after."""
    caches = (documents.parts_of, documents._hints, document_catalogue.units)

    def rests(found: MeasuredBoard) -> list[Reading]:
        return [Reading(volts, found.rest_error) for volts in found.rest.tolist()]

    asked = Question("level", "V", "level at rest", "the least level", rests, large=True)
    monkeypatch.setitem(QUESTIONS, "level", asked)
    place = written(tmp_path, DIVIDER)
    for cache in caches:
        cache.cache_clear()
    yield place
    for cache in caches:
        cache.cache_clear()


@pytest.mark.parametrize(("limit", "status"), [("2.9V", 0), ("3.1V", 1), ("3.0V", 3)])
def test_a_question_is_judged_and_shown(deck: Path, limit: str, status: int) -> None:
    """R2/(R1 + R2) of 4 V is 3 V; the limit is the least value."""
    result = command("check", str(deck), "--check", f"level={limit}", "--no-ngspice")
    assert result.exit_code == status, result.output
    assert re.search(r"level .* 3 V, at least", result.stdout)
    assert "level at rest" in result.stdout


def test_a_question_is_in_sweeps_documents_and_yields(deck: Path) -> None:
    spread = deck.with_name("parts.toml")
    spread.write_text('[parts]\nR2 = "10%"\n')
    found = taction.check(deck, checks="level=2V", tolerances=spread, samples=5)
    said = command("check", str(deck), "--over", "R2=1k:3k:2", "--no-ngspice", "--json")
    document = json.loads(said.stdout)
    assert document["outputs"][0]["level"] == pytest.approx(3.0, rel=1e-12)
    swept = [point["level"] for point in document["sweeps"][0]["points"]]
    assert swept == pytest.approx([2.0, 3.0], rel=1e-12)
    assert found.corners is not None
    (quantity,) = (q for q in found.corners.quantities if q.name == "level")
    assert (quantity.at_least, quantity.at_most) == (2.0, None)


@pytest.mark.parametrize("text", ["level", "level=2A", "level=2V@3"])
def test_a_limit_that_is_none_is_refused(deck: Path, text: str) -> None:
    with pytest.raises(taction.InputError, match="level"):
        taction.check(deck, checks=text, ngspice=False)


def checked(folder: Path, deck: str, spread: str, **more: object) -> BoardCheck:
    parts, options = folder / "parts.toml", {"ngspice": False, **more}
    parts.write_text(spread)
    return taction.check(written(folder, deck), tolerances=parts, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("deck", "spread", "quantity", "worst"), WORST)
def test_a_corner_has_the_worst_value_of_the_closed_form(
    deck: str, spread: str, quantity: str, worst: float, tmp_path: Path
) -> None:
    found = checked(tmp_path, deck, spread, samples=1)
    assert found.corners is not None
    (corner,) = (each for each in found.corners.corners if each.quantity == quantity)
    rel = 1e-9 if quantity == "growth_rate" else 1e-6
    assert corner.result.value(quantity) == pytest.approx(worst, rel=rel)


def test_the_yield_is_the_share_of_slow_capacitors(tmp_path: Path) -> None:
    """C is C0 1.05^z with z from -1 to 1: it is below 1.02 C0 in (1 + ln 1.02 / ln 1.05) / 2."""
    limit = 1.02 * TAU * math.log(100.0)
    spread, asked = 'capacitor = 0.05\ndistribution = "uniform"\n', f"settling={limit!r}@1%"
    found = checked(tmp_path, RC, spread, samples=100, checks=asked)
    assert found.yields is not None
    share = 0.5 * (1.0 + math.log(1.02) / math.log(1.05))
    assert found.yields.low <= share <= found.yields.high
    assert found.yields.samples == 100
    assert found.corners is not None
    (settling,) = (each for each in found.corners.quantities if each.name == "settling_time")
    assert (settling.at_least, settling.at_most) == (None, limit)
    assert found.outcome.value == "fail"  # a corner is beyond the limit, though the board passes
    assert {check.outcome.value for check in found.checks} == {"pass"}


def test_the_command_says_worst_cases_and_yield(tmp_path: Path) -> None:
    deck, parts = written(tmp_path, RC), tmp_path / "parts.toml"
    parts.write_text("capacitor = 0.05\n")
    call = ["check", str(deck), "--tolerances", str(parts)]
    result = command(*call, "-n", "20", "--no-ngspice")
    assert result.exit_code == 0, result.output
    assert "worst settling time" in result.output
    assert "20 of 20 boards pass" in result.output
    result = command(*call, "-n", "20", "--check", "settling=4.7us@1%", "--no-ngspice")
    assert result.exit_code == 1
    assert "settling time not kept" in result.output


@pytest.mark.parametrize(
    ("spread", "reason"),
    [
        ("coupling = 0.2\n", "K1 = 0.9 ± 20 %: reaches 1 within its tolerance"),
        ('[parts]\nnone = "1%"\n', "no part of the deck has this name; the nearest is"),
        ('parts = "1%"\n', "expected a table"),
        ('[params]\nk = "1%"\n', "did you mean 'parts'"),
    ],
)
def test_a_tolerance_that_cannot_be_is_refused(tmp_path: Path, spread: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        checked(tmp_path, TRANSFORMER, spread, samples=1)


def test_nodes_that_sources_hold_are_no_outputs(tmp_path: Path) -> None:
    """Vm reads a current: x and y move; in and p are where the sources hold them."""
    text = "Vin in 0 AC 1\nVos p in 1m\nE1 x 0 p z 1e5\nVm x y 0\nR1 y z 1\nC1 z 0 1n"
    found = taction.check(written(tmp_path, text), ngspice=False)
    assert {each.name for each in found.outputs} == {"x", "y", "z"}


def test_a_transient_without_a_known_end_leaves_the_poles(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def hidden(response: ExactResponse) -> None:
        raise EngineError("rounding hides the solution")

    monkeypatch.setattr(ExactResponse, "measured", hidden)
    found = taction.check(written(tmp_path, RC), ngspice=False)
    assert found.outcome.value == "pass"
    assert found.poles.rightmost.real == pytest.approx(-1e6)
    assert found.outputs[0].figures["settling_time"] is None
    assert "rounding hides how" in found.measurements.reason
