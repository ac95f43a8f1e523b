"""Every table of every command holds all names and numbers, however narrow the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.cli.main import COMMANDS
from taction.verification.evidence.paper import reproduce
from taction.verification.evidence.paper.findings import Chapter, Finding, load_claims
from taction.verification.evidence.paper.reproduce import Task
from tests.support.entries import write_fast
from tests.support.printed import printed_objects, shown_at, words_of

WIDTHS = (40, 80, 100)
TOLERANCES = "[tolerances]\nresistor = 0.01\ncapacitor = 0.05\n"

COMMAND_LINES: dict[str, tuple[str, ...]] = {
    "verify": ("a.toml", "--margins", "-v"),
    "verify several": ("a.toml", "slow.toml", "bad.toml", "--jobs", "1"),
    "diff": ("a.toml", "slow.toml"),
    "bom": ("a.toml",),
    "montecarlo": ("a.toml", "-n", "4", "--jobs", "1"),
    "corners": ("a.toml", "--corner", "capacitor=-1", "--corner", "resistor=1"),
    "onset": ("a.toml", "--over", "C=1fF:1pF:5", "--no-confirm"),
    "sweep": ("a.toml", "--over", "C=1pF:10pF:2", "--over", "opamp=ua741,op27", "--jobs", "1"),
    "regress": (".", "--baseline", "b.json", "--jobs", "1"),
    "stress": ("--only", "one-channel", "--jobs", "1"),
    "accuracy": ("a.toml", "--budget", "0.5"),
    "reproduce": ("--quick",),
    "models": (),
    "models show": ("show", "op27"),
    "tune": ("a.toml",),
    "choose": ("a.toml", "--opamps", "op27", "--points", "2", "--jobs", "1"),
}
WITHOUT_TABLES = {
    "netlist": "a deck",
    "kicad": "files, and what they leave out",
    "explore": "the address of a page",
    "solve": "one number a line",
    "simulate": "what `verify` shows of the channels",
    "new": "a file",
    "doctor": "two lines for each part",
    "scale": "lines",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_fast(tmp_path / "a.toml", more=TOLERANCES)
    write_fast(tmp_path / "slow.toml", limit="1us", capacitance="20pF")
    (tmp_path / "bad.toml").write_text("[problem]\nkind = 'tactil'\n")
    (tmp_path / "b.json").write_text('{"taction_baseline": 2, "scenes": {}}')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def quick_paper(monkeypatch: pytest.MonkeyPatch) -> None:
    """The chapters of the paper with results that cost nothing."""

    def chapter(quick: bool) -> Chapter:
        wanted = [claim for claim in load_claims() if claim.chapter == "reconstruction"]
        found = (Finding(c.id, "-3.3e-05 in 12 runs", "custom-matrix", c.expected) for c in wanted)
        return Chapter(tuple(found), ())

    task = Task("A title", chapter, 1.0, 1.0)
    monkeypatch.setattr(reproduce, "CHAPTERS", {"reconstruction": task})


def test_every_command_is_named_here() -> None:
    assert {name.split()[0] for name in COMMAND_LINES} | set(WITHOUT_TABLES) == set(COMMANDS)


@pytest.mark.usefixtures("folder", "quick_paper")
@pytest.mark.parametrize("name", COMMAND_LINES)
def test_a_narrow_page_loses_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = printed_objects(monkeypatch, name.split()[0], *COMMAND_LINES[name])
    wide = words_of(shown_at(200, objects))
    assert len(wide) > 10
    for width in WIDTHS:
        narrow = shown_at(width, objects)
        lost = wide - words_of(narrow)
        assert not lost, f"{width} columns:\n{narrow}"
        assert "…" not in narrow


@pytest.mark.usefixtures("folder")
def test_a_table_of_a_terminal_is_never_wider_than_the_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    objects = printed_objects(monkeypatch, "verify", *COMMAND_LINES["verify"])
    tables = [each for each in objects if type(each).__name__ == "FittedTable"]
    assert len(tables) >= 2
    for width in WIDTHS:
        text = shown_at(width, tables, terminal=True)
        assert max(map(len, text.splitlines())) <= width
        lost = words_of(shown_at(200, tables)) - words_of(text)
        assert not lost
