"""The demonstration tells what the paper says of its board."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

import taction
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.evidence import demonstration
from taction.verification.evidence.demonstration import Demonstration
from taction.verification.evidence.paper.findings import paper_scene
from taction.verification.verdict.checks import Outcome


@pytest.fixture(scope="module")
def told() -> Iterator[Demonstration]:
    """The story by the state-space engine; `tests/users` runs it as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            demonstration, "paper_scene", lambda name: paper_scene(name).with_engine("statespace")
        )
        yield taction.demo(None)


def test_the_boards_behave_as_told(told: Demonstration) -> None:
    assert told.outcome == "pass"
    assert [step.verdict.outcome.value for step in told.steps] == ["pass", "fail", "pass"]
    surprise = dataclasses.replace(told.steps[0], expected=Outcome.FAIL)
    assert dataclasses.replace(told, steps=(surprise, *told.steps[1:])).outcome == "fail"


def test_the_numbers_of_the_story_are_those_of_the_boards(told: Demonstration) -> None:
    """Frequency: of the rightmost eigenvalue by LAPACK; the others stand in the verdicts."""
    works, oscillates, settles = (step.text for step in told.steps)
    eigenvalues = np.linalg.eigvals(LinearBoard(told.steps[1].verdict.circuit).state_space.A)
    rightmost = eigenvalues[eigenvalues.real.argmax()]
    assert rightmost.real > 0.0
    assert f"oscillates at {abs(rightmost.imag) / 2e3 / np.pi:.1f} kHz" in oscillates
    assert "7 sensors" in works
    assert all("2.42 ms" in text for text in (works, settles))
    lam = {round(step.verdict.circuit.value("lambda"), 12) for step in told.steps}
    assert len(lam) == 1
