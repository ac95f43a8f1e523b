"""The shares of a simulation that are said."""

from __future__ import annotations

import math

import pytest

from taction.system import progress
from taction.system.progress import Clock, reached


def test_shares_are_said_within_a_stage_and_none_that_is_no_share(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(progress, "BETWEEN_SHARES", 0.0)
    lines: list[str] = []
    clock = Clock(lines.append)
    with clock.listening():
        clock.begin("run")
        for share in (0.5, math.nan, -0.1, 1.1, math.inf):
            reached(share)
        clock.pause()
        reached(0.6)
    reached(0.7)
    assert lines == ["run", "run, 50 of 100 %"]
    monkeypatch.undo()
    with clock.listening():
        clock.begin("short")
        reached(0.5)
    assert lines[2:] == ["short"]
