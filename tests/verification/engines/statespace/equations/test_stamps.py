"""Boards with the parts of a deck, stamped in a stack: each has the bytes that it has alone."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.stamps import stamp, stamp_together

CARDS = [
    "v1 in 0 dc 1", "i1 0 a dc 1m", "r1 in a 1k", "r2 a out 2k", "r3 a out 3k", "c1 a 0 1n",
    "c2 b out 2n", "l1 out c 1u", "l2 c 0 4u", "k1 l1 l2 0.9", "e1 b 0 a out 5", "g1 a 0 out b 3m",
    "v2 d 0 0", "r4 out d 1k", "f1 a 0 v2 0.1", "h1 e 0 v2 100", "r5 e a 10k", "v3 f b 0",
    "r6 f b 50", "r7 f a 70", "r8 b a 70",
]  # fmt: skip


def circuit() -> Circuit:
    return circuit_of(read_cards(CARDS), "all kinds", ["out"])


def arrays(found: Descriptor) -> list[bytes]:
    """Return the bytes of all arrays of equations."""
    values = [getattr(found, field.name) for field in fields(found)]
    parts = [*values, *(getattr(found.mass, name) for name in ("rows", "columns", "values"))]
    parts += [getattr(found.local, name) for name in ("rows", "columns", "values")]
    return [part.tobytes() for part in parts if isinstance(part, np.ndarray)]


@pytest.mark.parametrize("name", [knob.name for knob in circuit().knobs])
def test_every_kind_of_part_in_a_stack(name: str) -> None:
    board = circuit()
    boards = [board.turned(name, factor * board.value(name)) for factor in (1.0, 0.5, 0.25, 1.1)]
    stacked = stamp_together(boards)
    for one, found in zip(boards, stacked, strict=True):
        assert isinstance(found, Descriptor)
        assert arrays(found) == arrays(stamp(one))
        assert found.moved == stamp(one).moved
    first = stacked[0]
    assert isinstance(first, Descriptor)
    assert all(isinstance(each, Descriptor) and each.places is first.places for each in stacked)


def test_parts_that_cancel_at_one_value_only() -> None:
    """-1 kohm and R2 in parallel: at 1 kohm nothing is left of their sum, but of their rounding."""
    cards = ["v1 in 0 1", "r0 in a 3k", "r1 a 0 -1k", "r2 a 0 1k", "c1 a 0 1n", "r3 a 0 7k"]
    board = circuit_of(read_cards(cards), "cancelling", ["a"])
    boards = [board.turned("R2", ohms) for ohms in (500.0, 1000.0, 2000.0, 1000.0)]
    stacked = stamp_together(boards)
    for one, found in zip(boards, stacked, strict=True):
        assert isinstance(found, Descriptor)
        assert arrays(found) == arrays(stamp(one))
        siemens = 1.0 / 1e3 - 1.0 / 3e3 - 1.0 / 7e3 - 1.0 / one.value("R2")
        assert found.dense.stiffness[1, 1] == pytest.approx(siemens)
        _, sizes = found.summed(np.abs, np.zeros(0))
        siemens = 1.0 / 1e3 + 1.0 / 3e3 + 1.0 / 7e3 + 1.0 / one.value("R2")
        assert sizes[1, 1] == pytest.approx(siemens)


def test_a_part_within_one_row_adds_exactly_nothing() -> None:
    """R2 is parallel to V2: nothing of it is left, neither of its value nor of its rounding."""
    cards = ["v1 in 0 1", "r1 in a 1k", "v2 a b 0.0", "r2 a b 1m", "c1 b 0 1n"]
    found = stamp(circuit_of(read_cards(cards), "parallel", ["a"]))
    _, sizes = found.summed(np.abs, np.zeros(0))
    assert sizes.max() == pytest.approx(1.0)  # of the laws; R2 has 1000 S
    assert len(found.local.values) == len(
        stamp(
            circuit_of(
                read_cards([card for card in cards if not card.startswith("r2")]), "without", ["a"]
            )
        ).local.values
    )


def test_boards_with_other_nodes_are_not_stacked() -> None:
    one, other = (
        circuit_of(read_cards(["v1 in 0 1", "r1 in a 1k", "c1 a 0 1n", card]), "b", ["a"])
        for card in ("e1 b 0 a 0 2", "e1 b 0 a in 2")
    )
    for board, found in zip((one, other), stamp_together([one, other]), strict=True):
        assert isinstance(found, Descriptor)
        assert arrays(found) == arrays(stamp(board))
