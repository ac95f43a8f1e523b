"""What is fuzzed: inputs, and the property that each must have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hypothesis.strategies import SearchStrategy

from taction.system.errors import InputError, SimulationError, TactionError

LONGEST_MESSAGE = 2_010  # characters


@dataclass(frozen=True)
class Target:
    """A reader, its inputs, and what is asked of it.

    `examine` gets an input and an empty folder. It returns the outcome in a few words, lets a
    `TactionError` through, and fails if an accepted input has another meaning than it had to an
    independent reader.
    """

    name: str
    inputs: SearchStrategy[bytes]
    examine: Callable[[bytes, Path], str]

    def outcome(self, content: bytes, folder: Path) -> str:
        """Return the outcome of an input; any exception is a fault."""
        try:
            return self.examine(content, folder)
        except TactionError as error:
            check_message(error)
            return f"refused: {type(error).__name__}"


def check_message(error: TactionError) -> None:
    """Fail if an error does not say what is wrong."""
    text = str(error)
    assert text.strip()
    assert len(text) <= LONGEST_MESSAGE, f"a message of {len(text)} characters"
    assert "Traceback" not in text
    if isinstance(error, InputError):
        assert error.complaints
        assert all(complaint.accepted.strip() for complaint in error.complaints)
    if isinstance(error, SimulationError):
        assert error.exit_status == 3
