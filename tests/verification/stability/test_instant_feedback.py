"""Sources that follow at once, with and without feedback that would latch."""

from __future__ import annotations

from pathlib import Path

import pytest

import taction
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.verification.stability.instant_feedback import latching
from taction.verification.stability.poles import poles
from tests.support.designer_decks import DECKS
from tests.support.nodal_analysis import exact_poles

AMPLIFIER = ("v1 in 0 0.1", "r1 in n 1k", "r2 n out 10k", "c2 n out 1n")
STRAYS = ("c_n n 0 1f", "c_out out 0 1f", "c_in in 0 1f")


def delayed(gain: str) -> list[str]:
    """Return the inverting amplifier with the delay of 1 ps and the strays written by hand."""
    lag = ("g1 0 x n 0 " + gain, "rx x 0 1", "cx x 0 1p", "e1 out 0 x 0 1", "c_x x 0 1f")
    return [*AMPLIFIER, *lag, *STRAYS]


@pytest.mark.parametrize(("gain", "latches"), [("-1e6", False), ("1e6", True), ("12", True)])
def test_an_amplifier_latches_with_exchanged_inputs(gain: str, latches: bool) -> None:
    """Without a delay both poles are left of the axis; with it nodal analysis tells them apart."""
    cards = [*AMPLIFIER, f"e1 out 0 n 0 {gain}"]
    circuit = circuit_of(read_cards(cards), "amplifier", ["out"])
    assert poles(circuit).known_stable
    growing = [p for p in exact_poles(delayed(gain)) if p.real > 0.0 and p.imag == 0.0]
    assert bool(growing) is latches
    assert bool(latching(circuit)) is latches


def test_two_that_latch_are_seen_as_well_as_one() -> None:
    """An even number of growing real poles leaves the sign of the determinant as it is."""
    other = ("r3 in m 1k", "r4 m o2 10k", "c4 m o2 1n", "e2 o2 0 m 0 1e6", "e1 out 0 n 0 1e6")
    circuit = circuit_of(read_cards([*AMPLIFIER, *other]), "two", ["out"])
    assert poles(circuit).known_stable
    assert latching(circuit)


@pytest.mark.parametrize(("ohms", "latches"), [("-1meg", True), ("1meg", False)])
def test_a_source_by_current_latches_too(ohms: str, latches: bool) -> None:
    cards = ["vs a b 0", "r1 a 0 1k", "r2 b 0 10k", "r3 c b 1k"]
    circuit = circuit_of(read_cards([*cards, f"h1 c 0 vs {ohms}"]), "by current", ["c"])
    lag = [f"f1 0 x vs {ohms}", "rx x 0 1", "cx x 0 1p", "e1 c 0 x 0 1"]
    lag += [f"c{node} {node} 0 1f" for node in ("a", "b", "c")]
    growing = [p for p in exact_poles([*cards, *lag]) if p.real > 0.0 and p.imag == 0.0]
    assert bool(growing) is latches
    assert bool(latching(circuit)) is latches


def test_a_loop_of_capacitors_and_a_source_is_seen() -> None:
    """E9 drives n0 by n2, which C5 joins to n0: no state is between them."""
    cards = [
        "v1 in 0 1", "r1 n2 in 500k", "r2 n2 n0 5k", "c3 n2 in 61p", "c5 n2 n0 10n",
        "e9 0 n0 in n2 13.5",
    ]  # fmt: skip
    lag = ["g9 0 x in n2 13.5", "rx x 0 1", "cx x 0 1p", "e9 0 n0 x 0 1"]
    strays = [f"cs{node} {node} 0 1f" for node in ("in", "n0", "n2")]
    circuit = circuit_of(read_cards(cards), "capacitors", ["n2"])
    assert poles(circuit).known_stable
    assert any(p.real > 0.0 and p.imag == 0.0 for p in exact_poles([*cards[:-1], *lag, *strays]))
    assert latching(circuit)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize(
    "name", ["sallen-key-ideal", "howland-ideal", "wien-resistors", "quadrature", "phase-shift",
             "current-feedback", "ccvs-low-pass", "cccs-mirror"]
)  # fmt: skip
def test_sound_circuits_of_ideal_sources_are_stable(name: str, tmp_path: Path) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(DECKS[name])
    found = taction.check(place, ngspice=False)
    assert found.poles.stable, found.poles.doubt


@pytest.mark.usefixtures("ngspice")
def test_exchanged_inputs_are_not_called_stable() -> None:
    place = "tests/data/cases/swapped-inputs-stable.cir"
    found = taction.check(place, over="E1=0.5,100,1meg", ngspice=False)
    assert found.outcome.value == "inconclusive"
    assert found.poles.stable is None
    assert found.outputs[0].settling_time is None
    assert "positive feedback" in found.checks[0].reason
    (sweep,) = found.sweeps
    assert [point.stable for point in sweep.points] == [True, None, None]
    assert sweep.doubtful == (100.0, 1e6)
    assert sweep.stable_ranges == ((0.5, pytest.approx(1.0)),)
    (ends,) = taction.check(place, over="E1=100,1meg", ngspice=False).sweeps
    assert ends.stable_ranges == ()
