"""Damaged inputs of every kind; `make fuzz` draws others and more, which hypothesis shrinks.

There an input that takes `MOST_MEMORY` bytes or `LONGEST` seconds is a fault, too.
"""

from __future__ import annotations

import faulthandler
import os
import resource
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taction.system.errors import InputError
from tests.fuzz.documents import DOCUMENTS, STORED_FILES
from tests.fuzz.edits import check_message
from tests.fuzz.numbers import SIMULATOR_FILES, TABLES
from tests.fuzz.scenes_and_decks import DECKS, SCENE

EVERY = (SCENE, *TABLES, *SIMULATOR_FILES, *STORED_FILES, *DOCUMENTS, *DECKS)
TARGETS = {target.name: target for target in EVERY}
MANY = int(os.environ.get("TACTION_FUZZ", "0"))
FEW = {"scenes": 12, "decks": 12}
SOME = 50
LONGEST = 20.0  # s
MOST_MEMORY = 1_000_000_000  # bytes


@pytest.fixture
def limited() -> Iterator[None]:
    """Where many inputs are drawn, one that takes too much memory is a fault."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    if MANY:
        resource.setrlimit(resource.RLIMIT_AS, (used + MOST_MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.usefixtures("limited")
@pytest.mark.parametrize("name", TARGETS)
def test_an_error_that_says_why_or_a_right_answer(name: str) -> None:
    target = TARGETS[name]
    outcomes: set[str] = set()

    @settings(
        max_examples=MANY or FEW.get(name, SOME),
        derandomize=not MANY,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def run(data: st.DataObject) -> None:
        content = data.draw(target.inputs)
        if MANY:  # the process ends, and its stack is shown
            faulthandler.dump_traceback_later(LONGEST, exit=True)
        with tempfile.TemporaryDirectory() as folder:
            outcomes.add(target.outcome(content, Path(folder)))
        faulthandler.cancel_dump_traceback_later()

    run()
    assert len(outcomes) > 1  # inputs both good and damaged
    assert any(not outcome.startswith("refused") for outcome in outcomes)


def test_an_error_without_words_is_a_fault() -> None:
    with pytest.raises(AssertionError):
        check_message(InputError("x"))
