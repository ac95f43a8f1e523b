"""Benchmarks: figures, jobs in turns, the page, and every section with the least it measures."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.__main__ import SECTIONS
from benchmarks.measuring import Figure
from benchmarks.page import BEGIN, END, section, write_table


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


FIGURES = [
    Figure("kept", "one", [1.0, 2.0, 3.0], wanted=2.0, load=0.5),
    Figure("missed", "two", [0.5], wanted=1.0, least=True, load=9.25),
    Figure("seconds", "three", [4.0], wanted=1.5, value=1.25, unit="s", load=1.0),
    Figure("free", "four", [1e-5], load=0.0),
]


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
