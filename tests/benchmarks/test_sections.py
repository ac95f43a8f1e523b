"""Every section of the benchmarks runs, with the least that it can measure; no speed counts."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.__main__ import SECTIONS
from benchmarks.measuring import Extent
from benchmarks.page import section, write_plots

LONG = ("boards", "sweeps", "verdicts")  # even at their least


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.nightly] if n in LONG else []) for n in SECTIONS],
)
def test_a_section_measures(name: str, ngspice: str, tmp_path: Path) -> None:
    result = SECTIONS[name].measure(Extent.TINY)
    assert result.figures
    for figure in result.figures:
        assert all(0.0 < ratio < math.inf for ratio in figure.ratios)
        assert 0.0 < figure.measured < math.inf
    (tmp_path / "docs").mkdir()
    write_plots(tmp_path, {name: result})
    drawn = {path.name for path in (tmp_path / "docs").iterdir()}
    assert drawn == {f"benchmarks-{plot}" for plot in result.plots}
    text = section(name, SECTIONS[name], result)
    assert all(figure.what in text for figure in result.figures)
    assert all(f"](benchmarks-{plot})" in text for plot in result.plots)
