"""What stands in a terminal: remaining time on stderr, and tables of every width."""

from __future__ import annotations

import re
from itertools import count, pairwise
from pathlib import Path

import pytest

from taction.cli.printing import SparseLines, TimeLeft
from tests.support.command_lines import LINES
from tests.support.entries import write_fast
from tests.support.printed import printed_objects, shown_at, words_of
from tests.support.running import taction


def test_lines_become_rare() -> None:
    said: list[str] = []
    seconds = count(0.0, 1.0)
    lines = SparseLines(said.append, lambda: next(seconds))
    for number in range(1, 3601):
        lines.stage(str(number))
    assert said[:5] == ["10", "15", "23", "35", "53"]  # seconds, each 1.5 times the last
    assert len(said) == 20
    assert max(int(b) - int(a) for a, b in pairwise(said)) == 300


def test_the_start_of_the_workers_does_not_count() -> None:
    """Two tasks a second after five seconds of starting: 100 tasks take 50 s."""
    seconds = iter([5.0, 5.5, 6.0, 6.5, 60.0, 61.0])
    left = TimeLeft(lambda: next(seconds))
    texts = [left(f"{done} of 103 boards").partition(", ")[2] for done in (1, 2, 3, 4)]
    assert texts == ["", "", "about 50 s left", "about 50 s left"]
    assert left("corners: 5 of 103 boards") == "corners: 5 of 103 boards"  # another stage
    assert left("corners: 103 of 103 boards") == "corners: 103 of 103 boards"


@pytest.mark.parametrize(
    ("words", "stages"),
    [
        (("corners", "a.toml", "--jobs", "1"), {"sensitivities", "corner"}),
        (("montecarlo", "a.toml", "-n", "30", "--jobs", "1"), {"samples"}),
    ],
)
def test_every_long_study_says_what_is_left(
    words: tuple[str, ...], stages: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_fast(tmp_path / "a.toml", more="[tolerances]\nresistor = 0.01\n")
    monkeypatch.setattr("taction.cli.printing.FIRST", 0.0)
    monkeypatch.setattr("taction.cli.printing.GROWTH", 0.0)
    monkeypatch.setattr("taction.cli.printing.SETTLED", 0.0)
    lines = [line for line in taction(*words).stderr.splitlines() if "left" in line]
    assert len(lines) > 5
    assert all(re.search(r", about [\d.]+ (s|min|h) left$", line) for line in lines)
    assert {stage for stage in stages if any(stage in line for line in lines)} == stages


WIDTHS = (40, 80, 100)

# The variant of a command with the widest tables.
WIDE = {
    "verify": "verify a.toml --margins -v",
    "check": "check filter.cir --over Rf=1k:100k:5 --check stable --no-ngspice",
    "corners": "corners a.toml --corner capacitor=-1 --corner resistor=1",
    "sweep": "sweep a.toml --over C=1pF:10pF:2 --over opamp=ua741,op27 --jobs 1",
}
SAME = ("verify-files", "diff", "bom", "montecarlo", "regress", "models-show", "tune")
TABLES = {**{name: LINES[name] for name in SAME}, **WIDE}


@pytest.mark.usefixtures("boards")
@pytest.mark.parametrize("name", TABLES)
def test_a_narrow_page_loses_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = printed_objects(monkeypatch, *TABLES[name].split())
    wide = words_of(shown_at(200, objects))
    assert len(wide) > 10
    for width in WIDTHS:
        narrow = shown_at(width, objects)
        lost = wide - words_of(narrow)
        assert not lost, f"{width} columns:\n{narrow}"
        assert "…" not in narrow
