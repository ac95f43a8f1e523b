"""Poles that no output shows, and poles of the models beyond the band."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.instant_feedback import latching
from taction.verification.stability.poles import poles
from taction.verification.stability.shown_poles import BAND, told_apart

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
def test_a_pole_of_a_negative_capacitance_does_not_decide(
    cards: tuple[str, ...], rate: float
) -> None:
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
    """Two nodes with 1 mS each: 1 nF between them, and 3e-24 F that is lost beside it.

    Of ``s C (1 + s c r) + ...`` the second pole is at +1 mS / 3e-24 F.
    """
    made = board("r2 m 0 1k", "r3 n 0 1k", "c2 m n 1n", "c3 m 0 -3e-24")
    found = poles(made)
    assert found.stable is None
    assert found.doubt
    shown, apart = told_apart(made, found)
    assert shown.known_stable
    np.testing.assert_allclose(sorted(np.r_[shown.poles, apart.hidden].real), [-1e6, -5e5])
    assert apart.lost == 1
    assert "so far away" in apart.sentences[-1]
