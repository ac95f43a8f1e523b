"""Equations of parts that cancel."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.verification.engines.statespace.equations.stamps import stamp


def test_parts_that_cancel_at_one_value_only() -> None:
    """-1 kohm and R2 in parallel: at 1 kohm nothing is left of their sum, but of their rounding."""
    cards = ["v1 in 0 1", "r0 in a 3k", "r1 a 0 -1k", "r2 a 0 1k", "c1 a 0 1n", "r3 a 0 7k"]
    board = circuit_of(read_cards(cards), "cancelling", ["a"])
    for one in (board.turned("R2", ohms) for ohms in (500.0, 1000.0, 2000.0)):
        found = stamp(one)
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
