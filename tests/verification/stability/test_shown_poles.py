"""Poles that no output shows, and poles of the models beyond the band."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.verification.engines.statespace.linearised.board import LinearBoard
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
