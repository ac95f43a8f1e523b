"""Every section of the benchmarks runs, with the least that it can measure; no speed counts."""

from __future__ import annotations

import math

import pytest

from benchmarks.__main__ import SECTIONS
from benchmarks.page import section


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
