"""What follows a verdict never costs the verdict: its table, its exit status."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import taction
from taction.system import progress as after_result
from tests.support.entries import write_fast
from tests.support.running import document
from tests.support.running import taction as run

ENGINE = ("--engine", "statespace")
LIMITS = {"pass": "1s", "fail": "1ns"}
STATUS = {"pass": 0, "fail": 1}
VERIFY = "taction.verification.verdict.verify"
VIEW = "taction.verification.report.views"
DRAWN = "taction.verification.report.renderers"


@pytest.fixture(autouse=True)
def lenient(strict: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The steps may fail here, after the fixture that lets no step fail in other tests."""
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))


def broken(*given: Any, **more: Any) -> Any:
    raise ZeroDivisionError("boom")


@pytest.mark.parametrize("outcome", LIMITS)
@pytest.mark.parametrize(
    ("place", "says", "words"),
    [
        (f"{VERIFY}.all_warnings", "the warnings failed", ""),
        (f"{VERIFY}.error_budget", "the error budget failed", ""),
        (f"{VIEW}.verdict_view._headroom", "'Headroom' failed", ""),
        (f"{VIEW}.verdict_view.budget_table", "'Error budget' failed", ""),
        (f"{VIEW}.verdict_view.channel_table", "'Waveforms' failed", ""),
        (f"{VIEW}.answer_view.decisive_text", "the text failed", ""),
        (f"{DRAWN}.page.page_html", "--report failed", "--report x.html"),
        (f"{DRAWN}.picture.draw_page", "--plot failed", "--plot x.svg"),
    ],
)
def test_a_step_that_fails_leaves_outcome_and_status(
    outcome: str, place: str, says: str, words: str, boards: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = str(write_fast(boards / "a.toml", limit=LIMITS[outcome]))
    monkeypatch.setattr(place, broken)
    result = run("verify", scene, *ENGINE, "--changes", "0", *(words or "--verbose").split())
    assert result.exit_code == STATUS[outcome]
    assert f"{says}, the result stands: ZeroDivisionError: boom" in result.output
    assert result.stdout.rstrip().endswith(outcome.upper())
    assert "Traceback" not in result.output
    assert not list(boards.glob("x.*"))


@pytest.mark.parametrize("mode", [(), ("--json",)])
@pytest.mark.parametrize(
    ("error", "status", "says"),
    [
        (ZeroDivisionError("boom"), 1, "the search for changes failed, the result stands"),
        (taction.NoVerdictError("boom"), 1, "the search for changes failed, the result stands"),
        (MemoryError("boom"), 1, "the search for changes failed, the result stands"),
        (KeyboardInterrupt(), 130, "interrupted; the verdict stands"),
    ],
)
def test_a_search_that_ends_shows_the_verdict(
    mode: tuple[str, ...], error: BaseException, status: int, says: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def search(*given: Any, **more: Any) -> None:
        raise error

    monkeypatch.setattr(taction, "what_to_change", search)
    result = run("verify", str(write_fast(tmp_path / "a.toml", limit="1ns")), *ENGINE, *mode)
    assert result.exit_code == status
    assert says in result.stderr
    if mode:
        assert document(result)["outcome"] == "fail"
    else:
        assert result.stdout.rstrip().endswith("FAIL")
