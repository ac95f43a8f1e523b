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
VIEW = "taction.verification.report.views.verdict_view"


@pytest.fixture(autouse=True)
def lenient(strict: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The steps may fail here, after the fixture that lets no step fail in other tests."""
    monkeypatch.setattr(after_result, "FAILURES", (Exception,))


def broken(*given: Any, **more: Any) -> Any:
    raise ZeroDivisionError("boom")


@pytest.mark.parametrize("outcome", LIMITS)
@pytest.mark.parametrize(
    ("place", "says"),
    [
        (f"{VERIFY}.all_warnings", "the warnings failed"),
        (f"{VERIFY}.error_budget", "the error budget failed"),
        (f"{VIEW}._headroom", "'Headroom' failed"),
        (f"{VIEW}.budget_table", "'Error budget' failed"),
        (f"{VIEW}.channel_table", "'Waveforms' failed"),
        (f"{VIEW}.decisive_text", "the text failed"),
    ],
)
def test_a_step_that_fails_leaves_outcome_and_status(
    outcome: str, place: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = write_fast(tmp_path / "a.toml", limit=LIMITS[outcome])
    monkeypatch.setattr(place, broken)
    result = run("verify", str(scene), *ENGINE, "--changes", "0", "--verbose")
    assert result.exit_code == STATUS[outcome]
    assert f"{says}, the result stands: ZeroDivisionError: boom" in result.output
    assert result.stdout.rstrip().endswith(outcome.upper())
    assert "Traceback" not in result.output


@pytest.mark.parametrize("mode", [(), ("--json",)])
@pytest.mark.parametrize(
    "error", [ZeroDivisionError("boom"), taction.NoVerdictError("boom"), MemoryError("boom")]
)
def test_a_search_that_fails(
    mode: tuple[str, ...], error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def search(*given: Any, **more: Any) -> None:
        raise error

    monkeypatch.setattr(taction, "what_to_change", search)
    result = run("verify", str(write_fast(tmp_path / "a.toml", limit="1ns")), *ENGINE, *mode)
    assert result.exit_code == 1
    assert "the search for changes failed, the result stands" in result.stderr
    if mode:
        assert document(result)["outcome"] == "fail"


def test_ctrl_c_in_the_search_shows_the_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def search(*given: Any, **more: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(taction, "what_to_change", search)
    result = run("verify", str(write_fast(tmp_path / "a.toml", limit="1ns")), *ENGINE)
    assert result.exit_code == 130
    assert result.stdout.rstrip().endswith("FAIL")
    assert "interrupted; the verdict stands" in result.stderr


@pytest.mark.parametrize("outcome", LIMITS)
@pytest.mark.parametrize(
    ("option", "place"),
    [
        ("report.html", "taction.verification.report.renderers.page.page_html"),
        ("plot.svg", "taction.verification.report.renderers.picture.draw_page"),
    ],
)
def test_a_report_or_picture_that_fails(
    outcome: str, option: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = write_fast(tmp_path / "a.toml", limit=LIMITS[outcome])
    monkeypatch.setattr(place, broken)
    name = option.partition(".")[0]
    words = (f"--{name}", str(tmp_path / option), "--changes", "0")
    result = run("verify", str(scene), *ENGINE, *words)
    assert result.exit_code == STATUS[outcome]
    assert f"--{name} failed, the result stands: ZeroDivisionError: boom" in result.stderr
    assert not (tmp_path / option).exists()
    assert result.stdout.rstrip().endswith(outcome.upper())
