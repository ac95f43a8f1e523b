"""Decks with several operating points, and steps that leave the linear range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import taction
from taction.verification.studies.decks.board_check import BoardCheck
from tests.verification.studies.decks.test_measured_decks import HIDDEN, LATCH, SCHMITT

pytestmark = pytest.mark.usefixtures("ngspice")


def checked(folder: Path, text: str) -> BoardCheck:
    place = folder / "deck.cir"
    place.write_text(f"title\n{text}\n.end\n")
    return taction.check(place)


def drawn(kind: str, seed: int) -> str:
    """A deck of a kind with drawn values: its loop gain at rest is above 1."""
    draw = np.random.default_rng(seed)
    r, c = draw.uniform(0.5, 2.0, 4), draw.uniform(0.5, 2.0, 2)
    if kind == "latch":
        text = LATCH.replace("vcc a 1k", f"vcc a {r[0]}k").replace("vcc b 1k", f"vcc b {r[1]}k")
        return text.replace("a x 10k", f"a x {10 * r[2]}k").replace("b y 10k", f"b y {10 * r[3]}k")
    if kind == "schmitt":
        text = SCHMITT.replace("out p 10k", f"out p {10 * r[0]}k")
        return text.replace("p 0 10k", f"p 0 {10 * r[1]}k").replace("out 0 1n", f"out 0 {c[0]}n")
    if kind == "hidden":
        text = HIDDEN.replace("h2 h 1k", f"h2 h {r[0]}k").replace("h 0 1n", f"h 0 {c[0]}n")
        return text.replace("0.2*V(h)", f"{r[1]}*V(h)")
    text = f"V1 in 0 PULSE(0 10m)\nR1 in p {r[0]}k\nR2 p out {r[1]}k\nC1 x 0 {c[0]}n\n"
    return text + f"B1 x0 0 V=12*tanh({1e4 * r[2]}*V(p))\nR3 x0 x {r[3]}k\nE1 out 0 x 0 1"


@pytest.mark.parametrize("seed", range(1))
@pytest.mark.parametrize("kind", ["latch", "schmitt", "hidden", "exchanged"])
def test_a_deck_that_latches_is_named_with_its_points(kind: str, seed: int, tmp_path: Path) -> None:
    """Two stable points stand on either side of the unstable one."""
    found = checked(tmp_path, drawn(kind, seed))
    assert found.poles.stable is False
    assert found.outcome.value == "fail"
    assert any(note.startswith("at least 3 operating points") for note in found.notes), found.notes


@pytest.mark.parametrize(("volts", "said"), [(1e-4, False), (1.0, True)])
def test_a_step_beyond_the_linear_range_is_said(volts: float, said: bool, tmp_path: Path) -> None:
    """10 tanh(10 v): at 1 V the circuit gives 10 V, its slope 100 V."""
    text = f"V1 in 0 PULSE(0 {volts})\nB1 o 0 V=10*tanh(10*V(in))\nR1 o out 1k\nC1 out 0 1n"
    notes = [each for each in checked(tmp_path, text).notes if "too large" in each]
    assert bool(notes) is said
    if said:
        assert "v(out) = 10 V, the linear circuit 100 V" in notes[0]


def test_a_step_beyond_the_linear_range_of_an_inner_node_is_said(tmp_path: Path) -> None:
    """The output follows the input; a node beside it has 10 tanh(10 v)."""
    text = "V1 in 0 PULSE(0 1)\nB1 o 0 V=10*tanh(10*V(in))\nR1 o 0 1k\nR2 in out 1k\nC1 out 0 1n"
    notes = [each for each in checked(tmp_path, text).notes if "too large" in each]
    assert "v(o) = 10 V, the linear circuit 100 V" in notes[0]
