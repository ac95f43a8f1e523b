"""Margins and ranges of decks with poles many decades apart, against exact polynomials."""

from __future__ import annotations

import random
import warnings
from pathlib import Path

import pytest

from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.output_noise import output_noise
from taction.verification.stability import families
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import poles
from taction.verification.studies.board_sweep import Sweep, sweep_board
from taction.verification.studies.foreign_board import read_board
from taction.verification.studies.part_influence import influences
from taction.verification.studies.swept_values import SweptValue
from tests.support.nodal_analysis import exact_poles
from tests.support.wide_decks import wide_cards

CASES = Path(__file__).parents[2] / "data" / "cases"


def margin_of(board: LinearBoard) -> Margin:
    found, _ = influences(board, poles(board), every=True)
    assert found is not None
    return found


def case(name: str) -> LinearBoard:
    return LinearBoard(read_board(CASES / f"{name}.cir").circuit)


def swept(board: LinearBoard, text: str) -> Sweep:
    return sweep_board(board, SweptValue.of(text, board.circuit), "rest", 0.01)


@pytest.mark.parametrize(("name", "true"), [("margin-min", 2.0955), ("margin-d117", 5.5638)])
def test_poles_far_apart_hide_no_margin(name: str, true: float) -> None:
    """A part of negative value crosses first; true factors by 600 bits, to five digits."""
    found = margin_of(case(name))
    assert not found.doubt
    assert found.factor == pytest.approx(true, abs=6e-5)
    assert 0.0 < found.uncertainty < 0.03
    assert "E5 can grow" in found.text


def test_the_ranges_of_a_sweep_agree_with_its_table() -> None:
    found = swept(case("margin-min"), "R4=68k:1meg:5")
    assert [point.stable for point in found.points] == [True, True, False, False, False]
    ((low, high),) = found.stable_ranges
    assert (low, high) == (pytest.approx(68e3), pytest.approx(2.0961 * 68.58e3, rel=1e-4))
    (edge,) = found.crossings
    assert (edge.below, edge.above) == (0, 2)
    assert all(point.bound is not None and point.bound > 0.0 for point in found.points)


def test_a_crossing_has_a_bound_that_holds_the_true_one() -> None:
    (edge,) = swept(case("over-d213"), "RF0=1k:100k:5").crossings
    true = 6775.518704568816 * (1.0 - 2.2e-7)
    assert 1e-7 * true < abs(edge.value - true) <= edge.bound < 2e-6 * true


def test_noise_has_a_bound_that_holds_the_true_one() -> None:
    (rms,), (bound,) = output_noise(case("noise-d169"))
    assert abs(rms - 4.81562983331358e-05) <= bound < 1e-6 * rms


def test_two_loci_on_the_axis_warn_of_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = margin_of(case("howland"))
    assert found.factor == pytest.approx(2.990, abs=1e-3)


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


def test_without_counts_in_integers_poles_at_samples_find_what_loci_miss(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A deck with too many unknowns has no such count; its poles are not known well here."""
    monkeypatch.setattr(families, "_exact_counts", lambda _: {})
    found = margin_of(case("margin-min"))
    assert found.factor == pytest.approx(2.0955, abs=6e-5)
    assert abs(found.factor - 2.0954922) <= found.uncertainty
