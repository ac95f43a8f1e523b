"""Messages stay short, however long the input is."""

from __future__ import annotations

import pickle
import time
from pathlib import Path

import pytest

from taction.system import progress as after_result
from taction.system.errors import (
    MOST_LISTED,
    Complaint,
    DivergesError,
    InputError,
    SimulationError,
    TactionError,
)
from taction.system.processes import more_time, one_limit, time_left
from taction.system.progress import LONGEST, attempt
from taction.verification.studies.decks.foreign_board import read_board


def test_a_message_lists_some_mistakes_and_counts_the_others() -> None:
    complaints = [Complaint(f"key{number}", "", "unknown") for number in range(1000)]
    error = InputError("scene.toml", *complaints)
    lines = str(error).splitlines()
    assert len(error.complaints) == 1000
    assert lines[0] == "scene.toml: key0: unknown"
    assert len(lines) == MOST_LISTED + 1
    assert lines[-1] == f"scene.toml: and {1000 - MOST_LISTED} more mistakes"


@pytest.mark.parametrize(
    "error",
    [
        InputError("scene.toml", Complaint("design.gain", "-1", "must be above 0")),
        DivergesError("the outputs leave every bound", partial="so far"),
        SimulationError("no vector", log="line 1"),
    ],
)
def test_a_pickled_error_keeps_its_text_and_attributes(error: TactionError) -> None:
    again = pickle.loads(pickle.dumps(error))  # noqa: S301 - written in this line
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)


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


def test_a_step_that_fails_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))
    told: list[str] = []

    def step() -> int:
        raise ValueError("two\nlines " + "x" * 10_000)

    assert attempt("the step", step, 3, told.append) == 3
    assert told[0].startswith(r"the step failed, the result stands: ValueError: two\nlines x")
    assert len(told[0]) < LONGEST + 60
    assert attempt("the step", lambda: 4, 3, told.append) == 4
    assert len(told) == 1


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(2), BrokenPipeError()])
def test_what_is_no_failure_of_the_step_passes(
    error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))

    def step() -> None:
        raise error

    with pytest.raises(type(error)):
        attempt("the step", step, None, print, lambda each: isinstance(each, OSError))
