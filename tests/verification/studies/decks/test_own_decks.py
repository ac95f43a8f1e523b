"""The decks that taction writes, read back, are the boards that it wrote."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import taction
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.netlist_gen.topologies.frame.topology import TOPOLOGIES
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edge
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.foreign_board import read_board
from taction.verification.studies.decks.measured_board import measure_board
from taction.verification.studies.decks.part_influence import _least, _Nearest

READABLE = ("ngspice", "ltspice", "hspice")  # the dialects that ngspice can read
LINEAR = ("integrator", "passive", "inv", "pinv", "ridge")
SMALL = {
    "base": "ideal", "dc_gain": 1e5, "gbw": "1MHz", "second_pole": "2.5MHz",
    "output_resistance": "75ohm", "input_capacitance": "3pF",
}  # fmt: skip


def test_every_topology_of_taction_is_read_back() -> None:
    assert set(LINEAR) == set(TOPOLOGIES)


@pytest.mark.parametrize("dialect", READABLE)
@pytest.mark.parametrize(
    ("name", "topology"),
    [*(("", topology) for topology in LINEAR), ("known-readings", ""), ("custom-matrix", "")],
)
def test_a_deck_read_back_has_the_poles_and_readings_of_its_board(
    name: str, topology: str, dialect: str, tmp_path: Path, ngspice: str
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
    one, other = LinearBoard(deck.circuit), LinearBoard(board.circuit)
    found, again = poles(one), poles(other)
    assert board.initial == deck.analysis.initial
    assert [out.node for out in board.circuit.outputs] == [out.node for out in deck.circuit.outputs]
    assert len(found.poles) == len(again.poles)
    left = found.poles.tolist()
    for pole in again.poles.tolist():
        nearest = min(left, key=lambda each: abs(each - pole))
        left.remove(nearest)
        assert abs(nearest - pole) <= 1e-9 * abs(pole)
    assert found.known_stable
    first, second = (measure_board(each, board.initial, 0.01).measurements for each in (one, other))
    signs = np.array([out.sign for out in deck.circuit.outputs])
    for n, (a, b) in enumerate(zip(first.channels, second.channels, strict=True)):
        assert b.final == pytest.approx(signs[n] * a.final, rel=1e-9, abs=1e-12)
        for reading, value in a.readings.items():
            there = b.readings[reading]
            assert (value is None) == (there is None)
            if value is not None and there is not None:
                apart = value.uncertainty + there.uncertainty
                assert abs(value.value - there.value) <= 1e-7 * abs(value.value) + apart + 1e-9


@pytest.mark.nightly  # margins of 150 parts: a minute of processor time
def test_a_real_pole_that_crosses_beyond_the_margin_is_decided(
    tmp_path: Path, ngspice: str
) -> None:
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


def test_a_part_between_one_node_and_itself_moves_nothing(tmp_path: Path, ngspice: str) -> None:
    place = tmp_path / "rc.cir"
    parts = "R1 in out 1k\nC1 out 0 1n\nR5 0 0 1k\nC5 0 0 1n\nR6 out out 2k\n"
    place.write_text(f"t\nV1 in 0 PULSE(0 1)\n{parts}.end\n")
    found = taction.check(place, checks="margin=2", ngspice=False)
    assert found.outcome.value == "pass"
    rates = {row.name: row.real for row in found.parts}
    assert rates == {"R1": pytest.approx(1e6), "C1": pytest.approx(1e6), "R5": 0, "C5": 0, "R6": 0}


@pytest.mark.parametrize(("sure", "doubt"), [(1.5, "R1: a pole comes close"), (9.0, "")])
def test_a_doubt_counts_within_the_margin_only(sure: float, doubt: str) -> None:
    """A loop gain of 2 at R1/R2 = 1: the edge is at R2 of twice its value."""
    cards = ["v1 in 0 1", "r1 in a 1e3", "c1 a 0 1e-9", "g1 0 a a 0 5e-4", "r2 a 0 1e6"]
    circuit = circuit_of(read_cards(cards), "negative", ["a"])
    edge = Edge(2.002, 0.0, 0, 1, 1e-9)  # over the factor of the part
    doubtful = _Nearest(None, None, "a pole comes close", sure)
    least = _least(circuit, {"G1": _Nearest(above=edge), "R1": doubtful})
    assert least.factor == pytest.approx(2.002, rel=1e-6)
    assert least.doubt == doubt


def test_the_edges_of_a_negative_value_are_in_the_order_of_values() -> None:
    nearest = _Nearest(Edge(0.5, 0.0, 0, 1), Edge(2.0, 0.0, 0, 1))
    assert nearest.values(10.0) == (5.0, 20.0)
    assert nearest.values(-10.0) == (-20.0, -5.0)


def test_an_output_that_returns_settles_in_shares_of_its_exact_peak(tmp_path: Path) -> None:
    """A parallel resonator of quality 100: peak and settling time in closed form."""
    ohms, henry, farads = 1e5, 1e-2, 1e-8
    decay = 0.5 / (ohms * farads)
    turn = math.sqrt(1.0 / (henry * farads) - decay**2)
    deck = tmp_path / "pulse.cir"
    cards = f"R1 in out {ohms!r}\nL1 out 0 {henry!r}\nC1 out 0 {farads!r}"
    deck.write_text(f"pulse\nV1 in 0 PULSE(0 1)\n{cards}\n.end\n")
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
