"""Messages stay short, however long the input is."""

from __future__ import annotations

from taction.system.errors import LONGEST, MOST_LISTED, Complaint, InputError


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
