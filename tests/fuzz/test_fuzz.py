"""Some damaged inputs of every kind; `make fuzz` runs many more."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.targets import TARGETS

FEW = {"scenes": 30, "decks": 20, "stored verdicts": 50, "write-ahead logs of databases": 50}
SOME = 100


@pytest.mark.parametrize("name", TARGETS)
def test_an_error_that_says_why_or_a_right_answer(name: str) -> None:
    target = TARGETS[name]
    outcomes: set[str] = set()

    @settings(
        max_examples=FEW.get(name, SOME), database=None, suppress_health_check=list(HealthCheck)
    )
    @given(st.data())
    def run(data: st.DataObject) -> None:
        content = data.draw(target.inputs)
        with tempfile.TemporaryDirectory() as folder:
            outcomes.add(target.outcome(content, Path(folder)))

    run()
    assert len(outcomes) > 1  # inputs both good and damaged
    assert any(not outcome.startswith("refused") for outcome in outcomes)
