"""Simulating a transient: what is kept of a run that ends early."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.system.errors import DivergesError
from taction.verification.engines.statespace.transients import simulate
from taction.verification.verdict.design import design_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.progress import Clock
from taction.verification.verdict.simulation import begin
from taction.verification.waveforms import Cost, Waveforms
from tests.support.making import make_scene

RECORD = Waveforms(
    np.array([0.0, 1e-6]), ("v_1",), np.array([[0.0], [1e9]]), "statespace", Cost(0.0, 2, 1)
)


def design() -> PlannedBoard:
    return design_board(make_scene(), Clock(lambda stage: None))


@pytest.mark.parametrize("partial", [RECORD, None])
def test_the_record_of_a_diverging_transient_is_kept(
    monkeypatch: pytest.MonkeyPatch, partial: Waveforms | None
) -> None:
    def diverging(*_: object, **__: object) -> None:
        raise DivergesError("the board diverges", partial)

    made = replace(design(), engine="statespace")
    monkeypatch.setattr(simulate, "simulate", diverging)
    if partial is None:
        with pytest.raises(DivergesError):
            begin(made)
    else:
        pending = begin(made)
        assert pending.result().waveforms is RECORD
