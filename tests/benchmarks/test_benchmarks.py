"""Benchmarks: figures, jobs in turns, the page, and every section with the least it measures."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from benchmarks import deck, engines
from benchmarks.__main__ import SECTIONS, main
from benchmarks.measuring import Figure, in_turns, machine, python
from benchmarks.page import BEGIN, END, page, section, write_table
from taction.system.processes import THREADS
from tests.support.paths import ROOT


def test_a_figure_is_the_median_of_its_ratios() -> None:
    figure = Figure("a", "b", [4.0, 1.0, 2.0, 3.0, 5.0], wanted=3.0)
    assert (figure.measured, figure.quartiles) == (3.0, (2.0, 3.0, 4.0))
    assert figure.kept
    assert Figure("a", "b", [7.0]).quartiles == (7.0, 7.0, 7.0)


@pytest.mark.parametrize(
    ("wanted", "least", "kept"),
    [(2.0, False, True), (1.0, False, False), (2.0, True, False), (1.0, True, True)],
)
def test_a_value_of_its_own_keeps_an_upper_or_a_lower_limit(
    wanted: float, least: bool, kept: bool
) -> None:
    figure = Figure("a", "b", [9.0], wanted, value=1.5, unit="s", least=least)
    assert figure.kept is kept
    assert Figure("a", "b", [9.0]).kept  # without a limit


def test_jobs_take_turns() -> None:
    calls: list[str] = []
    jobs = {name: lambda name=name: calls.append(name) or float(len(calls)) for name in "ab"}
    found = in_turns(jobs, 3)
    assert calls[:2] == ["a", "b"]  # the warming up, which is not timed
    assert all(set(calls[k : k + 2]) == {"a", "b"} for k in (2, 4, 6))
    assert sorted(found["a"] + found["b"]) == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert [len(times) for times in in_turns(jobs, 1, warm=False).values()] == [1, 1]


def test_a_process_tells_its_cost() -> None:
    cost = python("import time; block = bytearray(100_000_000); time.sleep(0.05)")
    assert cost.wall > 0.05
    assert cost.processor > 0.0
    assert cost.memory > 100.0
    with pytest.raises(RuntimeError, match="oh no"):
        python("raise ValueError('oh no')")


def test_the_machine_has_no_paths(ngspice: str) -> None:
    text = machine()
    assert "Python 3" in text
    assert "BLAS kernel" in text
    assert "/" not in text
    assert str(ROOT) not in text


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


def test_a_section_that_fails_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ngspice: str
) -> None:
    def fail(*, tiny: bool) -> list[Figure]:
        raise RuntimeError("out of order")

    for name in THREADS:
        monkeypatch.setenv(name, "1")
    monkeypatch.setattr(deck, "measure", fail)
    monkeypatch.setattr(engines, "measure", lambda *, tiny: FIGURES)
    monkeypatch.setattr("sys.argv", ["bench", "--only", "deck", "engines"])
    assert main() == 1
    said = capsys.readouterr()
    assert "## deck\n\nNot measured: RuntimeError.\n" in said.out
    assert "## engines\n\nThe engine of state" in said.out
    assert "out of order" in said.err


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.nightly] if n == "studies" else []) for n in SECTIONS],
)
def test_a_section_measures(name: str, ngspice: str) -> None:
    figures = SECTIONS[name].measure(tiny=True)
    assert figures
    for figure in figures:
        assert all(0.0 < ratio < math.inf for ratio in figure.ratios)
        assert 0.0 < figure.measured < math.inf
    text = section(name, SECTIONS[name], figures)
    assert all(figure.what in text for figure in figures)
