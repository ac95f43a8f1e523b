"""Poles of circuits without design sense: each within its bound, and none missing or invented."""

from __future__ import annotations

import os

import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.pole_count import finite_poles
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.poles import Poles, poles
from tests.support.nodal_analysis import Pencil, exact_poles
from tests.support.random_circuits import random_cards

SEEDS = int(os.environ.get("TACTION_RANDOM_CIRCUITS", "60"))
EARLIER = (168, 484, 558, 563, 583, 1121, 1463, 2307, 2322, 2455, 2494, 2639, 2853, 2931)
"""Seeds of which a pole was outside its bound, or one too many."""
REFUSED = (
    "closes a loop of ideal voltage sources", "stay undetermined", "cancel to the last digit",
    "form a loop without a solution", "det(s M - K) = 0",
)  # fmt: skip


def circuit(cards: list[str]) -> Circuit:
    return circuit_of(read_cards(cards), "random", ["in"], {}, 15.0)


def answered(cards: list[str]) -> Poles | None:
    """Return the poles, or None where the circuit is refused with a known reason."""
    try:
        return poles(circuit(cards))
    except EngineError as error:
        assert any(reason in str(error) for reason in REFUSED), str(error)  # noqa: PT017
        return None


def assert_within(found: Poles, true: list[complex]) -> None:
    assert len(found.poles) == len(true)
    left = list(true)
    pairs = zip(found.poles.tolist(), found.errors.tolist(), strict=True)
    for pole, bound in sorted(pairs, key=lambda pair: pair[1]):
        nearest = min(left, key=lambda each: abs(each - pole))
        left.remove(nearest)
        assert abs(nearest - pole) <= bound, f"{pole}, not {nearest} within {bound}"


@pytest.mark.parametrize("first", range(0, SEEDS, 20))
def test_poles_are_within_their_bounds(first: int) -> None:
    """Against the roots of the exact polynomial, with 100 digits."""
    count = 0
    for seed in range(first, min(first + 20, SEEDS)):
        cards = random_cards(seed)
        if (found := answered(cards)) is not None:
            count += 1
            assert_within(found, exact_poles(cards))
    assert count >= 5  # the others are refused: loops of sources, unknowns that nothing determines


@pytest.mark.parametrize("seed", EARLIER)
def test_poles_that_were_wrong_are_right_or_refused(seed: int) -> None:
    cards = random_cards(seed)
    if (found := answered(cards)) is not None:
        assert_within(found, exact_poles(cards))


@pytest.mark.parametrize(
    ("cards", "count"),
    [
        (("r1 a 0 1", "c1 a b 1", "c2 b d 2", "c3 d a 3", "r2 d 0 1"), 2),  # they close a loop
        (("c1 a 0 0.1", "c2 a 0 0.2", "r1 a 0 1"), 1),
        (("c1 a b 1", "r1 a 0 1", "r2 b 0 1"), 1),  # it floats
        (("l1 a 0 1", "l2 a 0 2", "r1 a 0 1"), 2),  # a current that circles: a pole at 0
        (("c1 a 0 1", "r1 a 0 1", "g1 a 0 a 0 -1.0"), 1),  # an integrator
        (("c1 a 0 1", "f1 a 0 v1 -1.0", "c2 b d 1", "v1 d 0 0.0", "r1 a b 1"), 2),
        (("r1 a 0 1", "r2 a b 2", "r3 b 0 1"), 0),
    ],
)
def test_the_degree_is_counted_exactly(cards: tuple[str, ...], count: int) -> None:
    """Degrees by hand; the exact polynomial has them, too."""
    descriptor = LinearBoard(circuit(["i9 0 a 0.0", *cards])).descriptor
    assert finite_poles(descriptor, descriptor.dense.stiffness[:0, 0]) == count
    assert len(Pencil(cards).polynomial) == count + 1


def test_a_capacitance_that_nothing_determines_is_refused() -> None:
    descriptor = LinearBoard(circuit(["i9 0 a 0.0", "c1 b d 1", "r1 a 0 1"])).descriptor
    with pytest.raises(EngineError, match=r"det\(s M - K\) = 0"):
        finite_poles(descriptor, descriptor.dense.stiffness[:0, 0])


def test_parts_that_cancel_to_the_last_digit_are_refused() -> None:
    """A load of 1e4 ohm and a source of -1e-4 S: whether node a has a resistance is rounding."""
    cards = ["v1 in 0 1.0", "r1 a 0 30000", "r2 a 0 15000", "g1 a 0 a 0 -0.0001", "r3 in b 1k",
             "c1 b a 1n", "g2 b 0 a 0 1m"]  # fmt: skip
    with pytest.raises(EngineError):
        poles(circuit(cards))
