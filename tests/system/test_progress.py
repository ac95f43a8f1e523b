"""The time left inside one stage."""

from __future__ import annotations

import math

import pytest

from taction.system.progress import Clock, StageShares, reached, shares_to


def said(times: list[float], shares: list[float]) -> list[str]:
    lines: list[str] = []
    seconds = iter(times)
    receiver = StageShares(lines.append, "run", lambda: next(seconds))
    with shares_to(receiver):
        for share in shares:
            reached(share)
    return lines


def test_a_steady_simulation_has_the_time_that_is_left() -> None:
    # 5 % a second: at 4 s there are 80 % left, which take 16 s.
    lines = said([0.0, 2.0, 4.0, 19.0], [0.10, 0.20, 0.95])
    assert lines == [
        "run, 10 of 100 %, about 18 s left",
        "run, 20 of 100 %, about 16 s left",
        "run, 95 of 100 %, about 1 s left",
    ]


def test_the_first_second_says_nothing_and_lines_keep_apart() -> None:
    assert len(said([0.0, 0.9, 1.0, 1.1, 1.2, 1.3], [0.1, 0.11, 0.12, 0.13, 0.14])) == 2


def test_growing_steps_are_followed() -> None:
    """Of a share that doubles each second, the last half of the time counts, not the mean."""
    lines = said([0.0, 1.0, 2.0, 3.0, 4.0], [0.05, 0.1, 0.2, 0.4])
    # From 2 s (0.1) to 4 s (0.4): 0.15 a second, and 0.6 is left.
    assert lines[-1] == "run, 40 of 100 %, about 4 s left"


def test_another_simulation_of_the_same_stage_begins_anew() -> None:
    lines = said([0.0, 5.0, 6.0, 8.0], [0.9, 0.0, 0.5])
    assert lines[-1] == "run, 50 of 100 %, about 2 s left"
    assert len(lines) == 2


@pytest.mark.parametrize("share", [math.nan, -0.1, 1.1, math.inf])
def test_what_is_no_share_is_not_said(share: float) -> None:
    assert said([0.0, 9.0], [share]) == []


def test_nobody_listens_after_the_block() -> None:
    lines: list[str] = []
    clock = Clock(lines.append)
    with clock.listening():
        clock.begin("simulation")
    reached(0.5)
    assert lines == ["simulation"]
