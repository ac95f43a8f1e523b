"""The bare run that is the baseline: ngspice's own tolerances, and the wanted error."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import bare
from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.synthesis import synthesise
from taction.system.array_types import Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from tests.support.making import make_scene

BOARD = LinearBoard(synthesise(make_scene({"channels": 3}, design={"gain": 1e6})))
TRANSIENT = Transient(stop=2e-5, max_step=1e-7, truncation=1e-6)


def test_a_bare_deck_has_the_tolerances_of_ngspice() -> None:
    lines = bare.bare_deck(BOARD, TRANSIENT, 1e-3, 50.0).text.splitlines()
    options = [line for line in lines if line.startswith(".options")]
    assert options == [f".options {bare.solver()}", ".options reltol=0.001"]
    card, *times, start = lines[-2].split()
    assert (card, start) == (".tran", "uic")
    assert [float(time) for time in times] == pytest.approx([4e-10, 2e-5, 0.0, 4e-7])


def test_the_cheapest_run_has_the_wanted_error(ngspice: str) -> None:
    truth = bare.true_solution(BOARD, TRANSIENT)
    loose, tight = (bare.cheapest(BOARD, TRANSIENT, truth, e, 60.0) for e in (1e-2, 1e-5))
    assert loose is not None
    assert tight is not None
    assert loose.error <= 1e-2
    assert tight.error <= 1e-5
    assert loose.points < tight.points
    record = bare.run(tight.deck, 60.0)
    assert bare.error_of(record, truth, TRANSIENT.stop) == pytest.approx(tight.error)
    assert bare.cheapest(BOARD, TRANSIENT, truth, 1e-12, 60.0) is None


def test_the_error_is_a_share_of_the_step(ngspice: str) -> None:
    record = bare.run(bare.bare_deck(BOARD, TRANSIENT, 1e-3, 50.0), 60.0)
    truth = bare.true_solution(BOARD, TRANSIENT)

    def shifted(times: Floats) -> Floats:
        return truth(times) + 1e-2 * np.ones_like(times)[:, None]

    first, last = truth(np.array([0.0, TRANSIENT.stop]))
    share = 1e-2 / np.abs(last - first).max()
    found = bare.error_of(record, shifted, TRANSIENT.stop)
    assert found == pytest.approx(share, abs=bare.error_of(record, truth, TRANSIENT.stop))
