"""One limit of time for several runs."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from taction.system.errors import InputError
from taction.system.processes import more_time, one_limit, time_left
from taction.verification.studies.foreign_board import read_board


def test_runs_share_what_is_left() -> None:
    with one_limit(100.0):
        assert 99.0 < time_left(1e3) <= 100.0
        assert time_left(5.0) == 5.0
        with one_limit(1e3):  # never later than the one around it
            assert time_left(1e3) <= 100.0
        with more_time(50.0):
            assert 149.0 < time_left(1e3) <= 150.0
        assert time_left(1e3) <= 100.0
    assert time_left(1e3) == 1e3


@pytest.mark.parametrize("card", ["R2 out 0 1k", "D1 out 0 dx\n.model dx d(is=1f)"])
def test_no_run_begins_when_the_time_is_over(card: str, ngspice: str, tmp_path: Path) -> None:
    deck = tmp_path / "a.cir"
    deck.write_text(f"t\nV1 in 0 1\nR1 in out 1k\n{card}\nC1 out 0 1n\n.end\n")
    begin = time.process_time()
    with one_limit(0.0), pytest.raises(InputError, match="all runs of ngspice have together is"):
        read_board(deck)
    assert time.process_time() - begin < 2.0
