"""The page and the README's table, from figures that are made up."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks import deck, grid
from benchmarks.__main__ import main
from benchmarks.measuring import Figure
from benchmarks.page import BEGIN, END, page, section, write_table
from taction.system.processes import THREADS

FIGURES = [
    Figure("kept", "one", [1.0, 2.0, 3.0], wanted=2.0, load=0.5),
    Figure("missed", "two", [0.5], wanted=1.0, least=True, load=9.25),
    Figure("seconds", "three", [4.0], wanted=1.5, value=1.25, unit="s", load=1.0),
    Figure("free", "four", [1e-5], load=0.0),
]


def test_a_section_has_its_docstring_and_its_figures() -> None:
    text = re.sub(" +", " ", page("title", [section("deck", deck, FIGURES)]))
    assert "## deck\n\nHow long a deck takes to write" in text
    assert "| kept | one | 2 (1.5 to 2.5) | 3 | 0.5 | at most 2 | 2 |\n" in text
    assert "| missed | two | 0.5 (0.5 to 0.5) | 1 | 9.2 | at least 1 | **0.5** |\n" in text
    assert "| seconds | three | 4 (4 to 4) | 1 | 1.0 | at most 1.5 s | 1.25 s |\n" in text
    assert "| free | four | 1e-05 (1e-05 to 1e-05) | 1 | 0.0 | | 1e-05 |\n" in text


def test_the_table_of_the_readme_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}old\n{END}after\n", "utf-8")
    write_table(tmp_path, "title", {"deck": FIGURES})
    once = readme.read_text("utf-8")
    assert once.startswith(f"before\n{BEGIN}title\n\n| what ")
    assert once.endswith(f"{END}after\n")
    assert "old" not in once
    assert "| kept " in once
    assert "| missed " not in once  # a second limit of the section
    assert "| free " not in once  # without a limit
    write_table(tmp_path, "title", {"deck": FIGURES})
    assert readme.read_text("utf-8") == once


def test_a_readme_without_markers_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("text\n", "utf-8")
    with pytest.raises(AssertionError, match="no markers"):
        write_table(tmp_path, "title", {})
    assert (tmp_path / "README.md").read_text("utf-8") == "text\n"


def test_a_section_that_fails_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ngspice: str
) -> None:
    def fail(*, tiny: bool) -> list[Figure]:
        raise RuntimeError("out of order")

    for name in THREADS:
        monkeypatch.setenv(name, "1")
    monkeypatch.setattr(deck, "measure", fail)
    monkeypatch.setattr(grid, "measure", lambda *, tiny: FIGURES)
    monkeypatch.setattr("sys.argv", ["bench", "--only", "deck", "grid"])
    assert main() == 1
    said = capsys.readouterr()
    assert "## deck\n\nNot measured: RuntimeError.\n" in said.out
    assert "## grid\n\nWhat the simulations" in said.out
    assert "out of order" in said.err
