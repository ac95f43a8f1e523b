"""Margins of decks with poles far apart, sources that follow at once, and exact polynomials."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

import taction
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import poles
from taction.verification.stability.shown_poles import latching
from taction.verification.studies.decks.board_sweep import Sweep, sweep_deck, swept_axis
from taction.verification.studies.decks.foreign_board import read_board
from taction.verification.studies.decks.measured_board import measure_board
from tests.support.designer_decks import DECKS
from tests.support.nodal_analysis import exact_poles
from tests.support.random_circuits import wide_cards

CASES = Path(__file__).parents[2] / "data" / "cases"


def margin_of(board: LinearBoard) -> Margin:
    return measure_board(board, "rest", 0.01, every=True).margin


def case(name: str) -> LinearBoard:
    return LinearBoard(read_board(CASES / f"{name}.cir").circuit)


def swept(name: str, text: str) -> Sweep:
    deck = read_board(CASES / f"{name}.cir")
    return sweep_deck(deck, LinearBoard(deck.circuit), swept_axis(text, deck), 0.01)


@pytest.mark.parametrize(
    ("name", "true"),
    [pytest.param("margin-min", 2.0955, marks=pytest.mark.nightly), ("margin-d117", 5.5638)],
)
def test_poles_far_apart_hide_no_margin(name: str, true: float) -> None:
    """A part of negative value crosses first; true factors by 600 bits, to five digits."""
    found = margin_of(case(name))
    assert not found.doubt
    assert found.factor == pytest.approx(true, abs=6e-5)
    assert 0.0 < found.uncertainty < 0.03
    assert "E5 can grow" in found.text


def test_the_ranges_of_a_sweep_agree_with_its_table() -> None:
    found = swept("margin-min", "R4=68k:1meg:5")
    assert [point.stable for point in found.points] == [True, True, False, False, False]
    ((low, high),) = found.stable_ranges
    assert (low, high) == (pytest.approx(68e3), pytest.approx(2.0961 * 68.58e3, rel=1e-4))
    (edge,) = found.edges.edges
    assert (edge.below, edge.above) == (0, 2)
    assert all(point.bound is not None and point.bound > 0.0 for point in found.points)


def test_a_crossing_has_a_bound_that_holds_the_true_one() -> None:
    (edge,) = swept("over-d213", "RF0=1k:100k:5").edges.edges
    true = 6775.517208214921  # det K = 0 in rational numbers
    assert abs(edge.value - true) <= edge.bound < 2e-6 * true


def test_noise_has_a_bound_that_holds_the_true_one() -> None:
    (rms,), (bound,) = output_noise(case("noise-d169"))
    assert abs(rms - 4.81562983331358e-05) <= bound < 1e-6 * rms


def test_a_part_that_is_no_product_of_a_column_and_a_row_is_searched() -> None:
    """A coupling of coils: up to 1 no pole of a passive network crosses, beyond is none."""
    cards = ["v1 in 0 1", "r1 in a 50", "l1 a 0 1e-3", "l2 b 0 1e-3", "k1 l1 l2 0.5", "r2 b 0 50"]
    board = LinearBoard(circuit_of(read_cards(cards), "coupled", ["b"]))
    found = margin_of(board)
    assert "K1" in found.doubt or not found.doubt


def stable_with(cards: list[str], name: str, factor: float) -> bool:
    """Tell by exact polynomials whether all poles decay with a part's value times a factor."""
    changed = []
    for card in cards:
        *head, value = card.split()
        changed.append(card if head[0] != name else " ".join([*head, repr(float(value) * factor)]))
    return all(pole.real < 0.0 for pole in exact_poles(changed))


@pytest.mark.parametrize("first", [0, 3])
def test_margins_of_parts_over_many_decades(first: int) -> None:
    stable = 0
    for seed in range(first, first + 3):
        cards, draw = wide_cards(seed), random.Random(seed)  # noqa: S311 - no secret
        board = LinearBoard(circuit_of(read_cards(cards), "wide", ["out"]))
        if not poles(board).known_stable:
            continue
        stable += 1
        found = margin_of(board)
        assert not found.doubt
        least = found.factor - found.uncertainty
        for card in draw.sample(cards[1:], 2):
            for factor in (least, 1.0 / least, least ** draw.uniform(-1.0, 1.0)):
                assert stable_with(cards, card.split()[0], factor), (seed, card, factor)
        if found.factor < 100.0:
            beyond = found.factor + found.uncertainty
            names = [card.split()[0] for card in cards[1:]]
            sides = [(name, by) for name in names for by in (beyond, 1.0 / beyond)]
            assert not all(stable_with(cards, *side) for side in sides), seed
    assert stable


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
    assert found.outputs[0].figures["settling_time"] is None
    assert "positive feedback" in found.checks[0].reason
    (sweep,) = found.sweeps
    assert [point.stable for point in sweep.points] == [True, None, None]
    assert sweep.doubtful == (100.0, 1e6)
    assert sweep.stable_ranges == ((0.5, pytest.approx(1.0)),)
    (ends,) = taction.check(place, over="E1=100,1meg", ngspice=False).sweeps
    assert ends.stable_ranges == ()
