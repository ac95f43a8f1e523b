"""The baseline file: the same bytes for the same results, and every way it can be wrong."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from taction.system.errors import InputError
from taction.verification.studies.regression.baseline import (
    FORMAT,
    UNKNOWN,
    baseline_text,
    git_revision,
    load_baseline,
)
from tests.support.entries import entry


def test_a_baseline_is_read_as_it_was_written(tmp_path: Path) -> None:
    entries = {"b.toml": entry(name="b"), "a.toml": entry(times={"settling_time": [1e-6, None]})}
    file = tmp_path / "baseline.json"
    file.write_text(baseline_text(entries))
    assert load_baseline(file) == entries
    assert baseline_text(load_baseline(file)) == baseline_text(entries)
    assert baseline_text(dict(reversed(entries.items()))) == baseline_text(entries)


def test_the_file_has_a_line_a_waveform(tmp_path: Path) -> None:
    lines = baseline_text({"a.toml": entry()}).splitlines()
    assert '        "u_1": [0.0, 0.6321205588, 0.993262053]' in lines
    assert json.loads("\n".join(lines))["taction_baseline"] == FORMAT


def broken(change: dict[str, Any]) -> str:
    document = json.loads(baseline_text({"a.toml": entry()}))
    document["scenes"]["a.toml"] |= change
    return json.dumps(document)


WRONG = {
    "": "damaged, no JSON",
    '{"taction_baseline": 1, "scenes": {': "damaged, no JSON",
    "\x00\x01": "damaged, no JSON",
    "[" * 100_000: "damaged, no JSON",
    "[1, 2]": "no baseline of taction",
    '{"scenes": {}}': "no baseline of taction",
    '{"taction_baseline": 2, "scenes": {}}': "taction_baseline = 2: another format",
    '{"taction_baseline": 1}': "scenes: damaged",
    broken({"amplitude": "much"}): r"scenes\.a\.toml\.amplitude: damaged",
    broken({"amplitude": float("nan")}): r"scenes\.a\.toml\.amplitude: damaged",
    broken({"surprise": 1}): r"scenes\.a\.toml\.surprise: damaged",
    broken({"time": [0.0, 0.0, 1.0]}): "time does not increase",
    broken({"outputs": {"u_1": [1.0]}}): "an output and the time differ in length",
    broken({"poles": {}}): "growth_rate",
}


@pytest.mark.parametrize("text", WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_with_a_file_is_said_and_what_to_do(tmp_path: Path, text: str) -> None:
    file = tmp_path / "baseline.json"
    file.write_text(text)
    with pytest.raises(InputError, match=WRONG[text]) as caught:
        load_baseline(file)
    assert str(file) in str(caught.value)


def test_a_missing_file_names_the_option_that_makes_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="`--update` writes a baseline"):
        load_baseline(tmp_path / "none.json")
    with pytest.raises(InputError, match="not a regular file"):
        load_baseline(tmp_path)


def test_the_revision_is_git_s_own_or_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert git_revision(tmp_path) == UNKNOWN
    monkeypatch.setenv("PATH", str(tmp_path))
    assert git_revision(tmp_path) == UNKNOWN
    monkeypatch.undo()

    def git(*words: str) -> str:
        who = ("-c", "user.name=n", "-c", "user.email=e@example.org")
        run = subprocess.run(["git", "-C", tmp_path, *who, *words], capture_output=True, text=True)
        return run.stdout.strip()

    try:
        git("init", "-q")
    except FileNotFoundError:
        pytest.skip("no git")
    assert git_revision(tmp_path) == UNKNOWN  # no commit yet
    git("commit", "-q", "--allow-empty", "-m", "first")
    revision = git_revision(tmp_path)
    assert revision == git("rev-parse", "HEAD")
    assert len(revision) == 40


def test_a_text_is_no_number(tmp_path: Path) -> None:
    text = baseline_text({"one.toml": entry()})
    assert '"speed": 1000000.0' in text
    (tmp_path / "b.json").write_text(text.replace('"speed": 1000000.0', '"speed": "1000000.0"'))
    with pytest.raises(InputError, match=r"scenes\.one\.toml\.speed: damaged"):
        load_baseline(tmp_path / "b.json")
