"""The seam for what is asked of a deck: one entry of `QUESTIONS` is seen by every medium."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import taction
from taction.system import documents
from taction.verification.readings.readings import Reading
from taction.verification.report.documents import document_catalogue
from taction.verification.studies.decks.measured_board import MeasuredBoard
from taction.verification.studies.decks.questions import QUESTIONS, Question
from tests.support.running import taction as command

DIVIDER = "divider\nV1 in 0 PULSE(0 4)\nR1 in out 1k\nR2 out 0 3k\nC1 out 0 1n\n.end\n"


def rests(found: MeasuredBoard) -> list[Reading]:
    """The outputs at rest."""
    return [Reading(volts, found.rest_error) for volts in found.rest.tolist()]


@pytest.fixture
def deck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A deck, while there is one more question; documents are made anew before and after."""
    caches = (documents.parts_of, documents._hints, document_catalogue.units)
    asked = Question("level", "V", "level at rest", "the least level", rests, large=True)
    monkeypatch.setitem(QUESTIONS, "level", asked)
    place = tmp_path / "divider.cir"
    place.write_text(DIVIDER)
    for cache in caches:
        cache.cache_clear()
    yield place
    for cache in caches:
        cache.cache_clear()


@pytest.mark.parametrize(("limit", "status"), [("2.9V", 0), ("3.1V", 1), ("3.0V", 3)])
def test_a_question_is_judged_and_shown(deck: Path, limit: str, status: int, ngspice: str) -> None:
    """R2/(R1 + R2) of 4 V is 3 V; the limit is the least value."""
    result = command("check", str(deck), "--check", f"level={limit}", "--no-ngspice")
    assert result.exit_code == status, result.output
    assert re.search(r"level +\w+ +3 V .*at least", result.stdout)
    assert "level at rest" in result.stdout


def test_a_question_is_in_sweeps_documents_and_yields(deck: Path, ngspice: str) -> None:
    spread = deck.with_name("parts.toml")
    spread.write_text('[parts]\nR2 = "10%"\n')
    found = taction.check(deck, checks="level=2V", tolerances=spread, samples=5)
    said = command("check", str(deck), "--over", "R2=1k:3k:2", "--no-ngspice", "--json")
    document = json.loads(said.stdout)
    assert document["outputs"][0]["level"] == pytest.approx(3.0, rel=1e-12)
    swept = [point["level"] for point in document["sweeps"][0]["points"]]
    assert swept == pytest.approx([2.0, 3.0], rel=1e-12)
    assert found.corners is not None
    (quantity,) = (q for q in found.corners.quantities if q.name == "level")
    assert quantity.limits == (2.0, None)


@pytest.mark.parametrize("text", ["level", "level=2A", "level=2V@3"])
def test_a_limit_that_is_none_is_refused(deck: Path, text: str) -> None:
    with pytest.raises(taction.InputError, match="level"):
        taction.check(deck, checks=text, ngspice=False)
