"""The picture of a yield: what its panels show, and the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.system.errors import InputError
from taction.verification.report.picture import new_figure
from taction.verification.report.tolerance.yield_plot import _edges, _histogram, plot_yield
from taction.verification.studies.tolerance.remedy import Remedy
from taction.verification.studies.tolerance.yield_report import Sensitivity, Spread, YieldReport
from tests.support.sweeping import make_sample

SAMPLES = [
    make_sample(
        k, "pass" if k < 30 else "fail", settling_time=1e-5 * (1 + k / 40), growth_rate=-5.0
    )
    for k in range(40)
]
TIME = Spread("settling_time", "s", None, 1.76e-5, 1e-5, 1.5e-5, 2e-5, 0)
REPORT = YieldReport(
    samples=40,
    passed=30,
    without_verdict=0,
    fraction=0.75,
    low=0.59,
    high=0.87,
    failures={"settling_time": 10},
    reasons={},
    quantities=(TIME, Spread("growth_rate", "1/s", None, 0.0, -5.0, -5.0, -5.0, 0)),
    sensitivities=(Sensitivity("Cc_1", "capacitor", "settling_time", -0.9, 0.15),),
    remedy=Remedy({"Cc_1": 0.01}, {}, 0.99, 1.0),
)


def drawn(spread: Spread) -> Any:
    values = np.array([sample.value(spread.name) for sample in SAMPLES])
    with new_figure(4, 3) as figure:
        axes = figure.add_subplot()
        _histogram(axes, spread, values)
    return axes


def test_bars_beyond_the_limit_are_hatched_and_all_samples_are_shown() -> None:
    axes = drawn(TIME)
    bars = [bar for bar in axes.patches if bar.get_height()]
    within = sum(bar.get_height() for bar in bars if not bar.get_hatch())
    assert (within, sum(bar.get_height() for bar in bars)) == (31, 40)  # up to 1e-5 (1 + 30/40)
    assert {bool(bar.get_x() >= 1.7599e-5) is bool(bar.get_hatch()) for bar in bars} == {True}
    assert axes.lines[0].get_xdata()[0] == TIME.at_most
    assert axes.get_title() == "settling time: 22.5 % beyond 17.6 us"


def test_a_limit_far_away_is_an_arrow() -> None:
    axes = drawn(replace(TIME, at_most=1.0))
    assert not axes.lines
    assert axes.get_xlim()[1] < 3e-5
    assert [text.get_text() for text in axes.texts] == ["limit →"]


def test_one_value_is_no_histogram() -> None:
    axes = drawn(REPORT.quantities[1])
    assert [text.get_text() for text in axes.texts] == ["every sample: -5 /s"]
    assert not axes.patches


@pytest.mark.parametrize("limits", [[], [0.31], [2.0], [0.2, 0.7]])
def test_a_limit_among_the_values_is_an_edge(limits: list[float]) -> None:
    values = np.linspace(0.0, 1.0, 101)
    edges = _edges(values, limits)
    assert edges[0] <= 0.0
    assert edges[-1] >= 1.0
    assert np.diff(edges) == pytest.approx(np.full(len(edges) - 1, edges[1] - edges[0]))
    if limits and limits[0] < 1.0:
        assert np.abs(edges - limits[0]).min() < 1e-12


def test_the_file_is_always_the_same(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        plot_yield("board", REPORT, SAMPLES, str(tmp_path / name))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with pytest.raises(InputError, match="--plot"):
        plot_yield("board", REPORT, SAMPLES, str(tmp_path / "a.xyz"))


def test_a_study_without_samples_has_a_picture(tmp_path: Path) -> None:
    empty = replace(REPORT, samples=0, passed=0, quantities=(), sensitivities=(), remedy=None)
    plot_yield("board", empty, [], str(tmp_path / "a.svg"))
    assert (tmp_path / "a.svg").read_text().count("<path") > 5
