"""Poles and time scales, against closed forms and the calibration of the paper's board."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import EPS
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.stability.poles import poles
from taction.verification.stability.shown_poles import BAND, latching, told_apart
from tests.support.boards import paper_board, single_mode
from tests.support.measured import rounded_poles
from tests.support.readings import Samples, rise_time

TAU = 0.455e-6


@pytest.mark.parametrize("ratio", [0.015, 0.5, 20.0, 60.0])
def test_the_single_mode_has_the_roots_of_its_cubic(ratio: float) -> None:
    found = poles(single_mode(ratio * TAU))
    cubic = np.polymul([ratio, 1.0], [1.0, 2.0, 1.0])
    cubic[-1] += 100.0
    assert np.sort_complex(found.poles * TAU) == pytest.approx(
        np.sort_complex(np.roots(cubic)), rel=1e-6
    )
    assert found.complete


@pytest.mark.parametrize(("C", "stable"), [(10e-12, True), (9e-12, True), (8.2e-12, False)])
def test_the_papers_board_is_stable_where_the_paper_says(C: float, stable: bool) -> None:
    assert poles(paper_board(C)).stable is stable


def test_the_papers_board_rises_in_ten_microseconds_and_rings_for_half_a_millisecond() -> None:
    scales = time_scales(paper_board(), error=1e-4, points=125.0)
    time = np.linspace(0.0, 20e-6, 2001)
    solution = exact_solution(paper_board())
    final = float(solution.final[3])
    rise = rise_time(Samples.of_record(time, solution.at(time)[:, 3], final), final)
    assert rise == pytest.approx(9.5e-6, rel=0.02)
    assert -1.0 / scales.ringing[0].real == pytest.approx(0.5e-3, rel=0.15)
    assert scales.max_step == pytest.approx(math.tau / scales.ringing[0].imag / 125.0)
    assert scales.growth_time == np.inf
    left = scales.amplitudes @ np.exp(scales.poles.real * scales.stop)
    assert left == pytest.approx(1e-4, rel=1e-3)
    assert scales.stop_for(1e-2) < scales.stop < scales.stop_for(1e-6)


def test_an_unstable_board_is_given_time_to_show_it() -> None:
    scales = time_scales(paper_board(5e-12))
    assert scales.ringing[0].real > 0.0
    assert 0.0 < scales.growth_time <= scales.stop < np.inf


def test_a_board_without_oscillating_poles_has_no_frequency() -> None:
    found = rounded_poles(np.array([-3.0, -1.0], dtype=np.complex128))
    assert (found.rightmost, found.stable) == (-1.0, True)
    assert (found.damping_ratio, found.frequency) == (1.0, 0.0)
    nothing = rounded_poles(np.zeros(0, dtype=np.complex128))
    assert nothing.stable


@pytest.mark.parametrize(("opamp", "gain", "unstable"), [("ua741", 1e3, 0), ("tl084", 3e5, 10)])
def test_unstable_poles_of_nearly_defective_cells(opamp: str, gain: float, unstable: int) -> None:
    """The counts are those of the poles with 80 digits: -25189 +- 73794j is the rightmost."""
    T = np.eye(5, k=1)
    scene = Scene.from_arrays(
        T, T @ np.ones(5), capacitance=1e-14, gain=gain, opamp=opamp, lam=0.1,
        unit_conductance="10uS",
    )  # fmt: skip
    circuit = synthesise(scene)
    assert poles(circuit).unstable_count == unstable


@pytest.mark.parametrize(
    ("opamp", "gain", "C"),
    [
        ("tl084", 1e4, 1.2658030773648652e-12),
        ("ua741", 1e4, 1.0466766142971814e-11),
        ("op27", 1e5, 2.870828828623284e-11),
    ],
)
def test_poles_that_nearly_meet_are_within_their_errors(opamp: str, gain: float, C: float) -> None:
    """Two real poles become a pair at C; against those of the stamped equations with 60 digits."""
    scene = Scene.from_arrays(
        np.eye(1), np.ones(1), capacitance=C, gain=gain, opamp=opamp, lam=0.1,
        unit_conductance="10uS",
    )  # fmt: skip
    board = LinearBoard(synthesise(scene))
    found = poles(board)
    dense = board.descriptor.dense
    with mp.workdps(60):
        mass, stiffness = mp.matrix(dense.mass.tolist()), mp.matrix(dense.stiffness.tolist())
        beside = mp.mpf(3e6)  # where no pole is
        listed, _ = mp.eig(mp.inverse(beside * mass - stiffness) * mass)
        true = [beside - 1 / value for value in listed if abs(value) > mp.mpf(10) ** -25]
        off = np.array([min(float(abs(mp.mpc(p) - t)) for t in true) for p in found.poles])
    assert len(true) == len(found.poles)
    assert off.max() > 64.0 * EPS * np.abs(found.poles).max()
    assert np.all(off <= found.errors)
    assert np.all(found.errors <= 1e-3 * np.abs(found.poles))


SEEN = ["v1 in 0 1", "r1 in out 1k", "c1 out 0 1n"]  # -1 M/s


def board(*cards: str) -> LinearBoard:
    return LinearBoard(circuit_of(read_cards([*SEEN, *cards]), "a", ["out"]))


def test_a_slow_pole_that_no_output_shows_stands_apart() -> None:
    made = board("r2 in s 1meg", "c2 s 0 1u")  # -1 /s behind the source
    shown, apart = told_apart(made, poles(made))
    np.testing.assert_allclose(shown.poles, [-1e6])
    np.testing.assert_allclose(apart.hidden, [-1.0])
    assert shown.stable
    assert "-1 /s" in apart.sentences[0]


def test_a_pole_that_an_output_shows_a_little_decides() -> None:
    made = board("r2 out s 1000meg", "c2 s 0 1u")
    shown, apart = told_apart(made, poles(made))
    assert shown.rightmost.real == pytest.approx(-1e-3, rel=1e-2)
    assert not len(apart.hidden)


@pytest.mark.parametrize("ohms", ["-1meg", "-300k"])
def test_a_growing_pole_that_no_output_shows_decides_and_is_named(ohms: str) -> None:
    made = board(f"r2 s 0 {ohms}", "r3 s 0 2meg", "c2 s 0 1u")
    shown, apart = told_apart(made, poles(made))
    assert shown.known_unstable
    assert apart.unseen


def test_a_pole_of_a_model_beyond_the_band_does_not_decide() -> None:
    """1 mS drives a negative capacitance of 1 fF: 1 pF beside it makes it positive."""
    made = board("r2 m 0 1k", "c2 m 0 -1f")
    found = poles(made)
    assert found.rightmost.real == pytest.approx(1e12)
    shown, apart = told_apart(made, found)
    np.testing.assert_allclose(shown.poles, [-1e6])
    np.testing.assert_allclose(apart.far, [1e12])
    assert "+1 T/s" in apart.sentences[0]


def test_a_fast_latch_is_none_of_the_models() -> None:
    """Two inverters of 1 mS at 1 fF each grow with (1 - 1/2) 1e12 /s, whatever is added."""
    made = board(
        *("g1 a 0 b 0 1m", "g2 b 0 a 0 1m"),
        *("r2 a 0 2k", "r3 b 0 2k", "c2 a 0 1f", "c3 b 0 1f"),
    )
    shown, apart = told_apart(made, poles(made))
    assert abs(shown.rightmost) > math.tau * BAND
    assert shown.known_unstable
    assert not len(apart.far)


@pytest.mark.parametrize(
    ("cards", "rate"),
    [
        # a zero of a vendor's model at 100 MHz, with a capacitor of a negative value
        (("e2 x 0 out 0 1meg", "r2 x m 1meg", "c2 m x -1.59f", "r3 m 0 1"), 1e6 / 1.59e-9),
        # the same made by sources: the current of 1 fF, taken back with a gain of -1
        (
            (
                *("e2 x 0 out 0 1meg", "r2 x m 1meg", "r3 m 0 1", "f2 x m v2 -1"),
                *("v2 p 0 0", "e3 q 0 x m 1", "c2 p q 1.59f"),
            ),
            1e6 / 1.59e-9,
        ),
    ],
)
def test_poles_of_negative_capacitances_do_not_decide(cards: tuple[str, ...], rate: float) -> None:
    made = board(*cards)
    found = poles(made)
    assert found.rightmost.real == pytest.approx(rate, rel=1e-5)
    shown, apart = told_apart(made, found)
    assert shown.known_stable
    assert apart.beyond
    assert not latching(made.circuit)


def test_a_pole_of_a_model_where_strays_of_one_size_leave_no_digit() -> None:
    """1 uohm beside 1e-18 F: a pole at -1e24 /s, whose rounding hides all others."""
    cards = [
        *("e2 x 0 n 0 1meg", "r3 m 0 1u", "f2 x m v2 -1", "v2 p 0 0", "e3 q 0 x m 1"),
        *("c2 p q 2.9n", "c4 n 0 80n", "r4 n 0 87k", "e1 o 0 a x 1", "r5 a n 1u"),
    ]
    made = LinearBoard(circuit_of(read_cards(cards), "a", ["n"]))
    shown, apart = told_apart(made, poles(made))
    np.testing.assert_allclose(apart.far, [1e6 / 2.9e-9], rtol=1e-3)
    assert shown.known_stable


def test_a_pole_that_rounding_hides_is_said_and_does_not_decide() -> None:
    """Two nodes with 1 mS each: 10 nF between them, and 3e-23 F that is lost beside it.

    Of ``s C (1 + s c r) + ...`` the second pole is at +1 mS / 3e-23 F.
    """
    made = board("r2 m 0 1k", "r3 n 0 1k", "c2 m n 10n", "c3 m 0 -3e-23")
    found = poles(made)
    assert found.stable is None
    assert found.doubt
    shown, apart = told_apart(made, found)
    assert shown.known_stable
    np.testing.assert_allclose(sorted(np.r_[shown.poles, apart.hidden].real), [-1e6, -5e4])
    assert apart.lost == 1
    assert "so far away" in apart.sentences[-1]
