"""The picture of a yield: what its panels show, and the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.verification.report.blocks import Notes
from taction.verification.report.charts import Chart, Columns, Limit, Text
from taction.verification.report.renderers.picture import draw_sheet
from taction.verification.report.views.montecarlo import _edges, sheet
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


def charts(report: YieldReport) -> list[Any]:
    (column, *more) = sheet("board", report, SAMPLES).columns
    return [*column, *(block for each in more for block in each)]


def histogram(spread: Spread) -> Chart:
    (chart, *_) = charts(replace(REPORT, quantities=(spread,)))
    assert isinstance(chart, Chart)
    return chart


def marks(chart: Chart, kind: type) -> list[Any]:
    return [mark for mark in chart.marks if isinstance(mark, kind)]


def test_bars_beyond_the_limit_are_failures_and_all_samples_are_shown() -> None:
    chart = histogram(TIME)
    within, beyond = marks(chart, Columns)
    assert (within.looks, within.sizes.sum()) == (("pass",), 31)  # up to 1e-5 (1 + 30/40)
    assert (beyond.looks, beyond.sizes.sum()) == (("fail",), 9)
    assert (beyond.places[beyond.sizes > 0] > 1.76e-5).all()
    assert [limit.value for limit in marks(chart, Limit)] == [TIME.at_most]
    assert chart.message == "9 of 40 samples (22.5 %) beyond 17.6 µs"


def test_a_limit_far_away_is_an_arrow() -> None:
    chart = histogram(replace(TIME, at_most=1.0))
    first, second = chart.views
    assert first.x is not None
    assert first.x[1] < 3e-5
    assert second.x is not None
    assert second.x[1] > 1.0
    assert [text.text for text in marks(chart, Text)] == ["limit →"]


def test_one_value_is_no_histogram() -> None:
    notes = next(each for each in charts(REPORT) if isinstance(each, Notes))
    assert notes.lines == ("Growth rate: every sample has -5 /s.",)


@pytest.mark.parametrize("limits", [[], [0.31], [2.0], [0.2, 0.7]])
def test_a_limit_among_the_values_is_an_edge(limits: list[float]) -> None:
    values = np.linspace(0.0, 1.0, 101)
    edges = _edges(values, limits)
    assert edges[0] <= 0.0
    assert edges[-1] >= 1.0
    assert np.diff(edges) == pytest.approx(np.full(len(edges) - 1, edges[1] - edges[0]))
    if limits and limits[0] < 1.0:
        assert np.abs(edges - limits[0]).min() < 1e-12


def test_a_study_without_samples_has_a_picture(tmp_path: Path) -> None:
    empty = replace(REPORT, samples=0, passed=0, quantities=(), sensitivities=(), remedy=None)
    draw_sheet(sheet("board", empty, []), tmp_path / "a.svg")
    assert (tmp_path / "a.svg").read_text().count("<path") > 5
