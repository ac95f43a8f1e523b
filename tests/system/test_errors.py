"""Messages stay short, however long the input is."""

from __future__ import annotations

import pickle

import pytest

from taction.system.errors import (
    LONGEST,
    MOST_LISTED,
    Complaint,
    DivergesError,
    InputError,
    SimulationError,
    TactionError,
)


def test_a_complaint_keeps_the_ends_of_a_long_text() -> None:
    text = "<" + "x" * 1_000_000 + ">"
    complaint = Complaint(text, text, text)
    for name, most in LONGEST.items():
        kept = getattr(complaint, name)
        assert len(kept) <= most + 5
        assert kept.startswith("<xx")
        assert kept.endswith("xx>")
        assert " ... " in kept
    assert str(Complaint("key", "1", "a text")) == "key = 1: a text"


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
