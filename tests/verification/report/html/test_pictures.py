"""Pictures: what Plotly accepts, what they show, and what they leave out."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from taction.verification.report.blocks import PAGE
from taction.verification.report.charts import Chart
from taction.verification.report.html.blocks import Block, Picture, Report
from taction.verification.report.html.pictures import thinned
from taction.verification.report.renderers.plotly import plotly_spec, view_layout
from tests.support.report_pages import STUDIES, VERDICTS, page

MARKED = "#123456"  # in the place of a colour of the style sheet


def blocks(report: Report) -> Iterator[Block]:
    for section in report.sections:
        yield from section.made(PAGE)


def pictures(report: Report) -> dict[str, Picture]:
    return {block.title: block for block in blocks(report) if isinstance(block, Picture)}


def coloured(value: Any) -> Any:
    if isinstance(value, str):
        return MARKED if value.startswith("--") else value
    if isinstance(value, dict):
        return {key: coloured(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [coloured(each) for each in value]
    return value


@pytest.mark.parametrize("name", [*VERDICTS, *STUDIES])
def test_plotly_accepts_every_picture(name: str) -> None:
    import plotly.graph_objects as go

    for picture in pictures(page(name)).values():
        spec = coloured(json.loads(json.dumps(picture.spec, allow_nan=False)))
        go.Figure(spec)  # raises for an unknown property or value
        for view in picture.views:
            go.Figure(spec).update_layout({k.replace(".", "_"): v for k, v in view.layout.items()})
        assert picture.title
        assert picture.summary
    for chart in (block for block in blocks(page(name)) if isinstance(block, Chart)):
        spec = coloured(json.loads(json.dumps(plotly_spec(chart), allow_nan=False)))
        go.Figure(spec)
        for view in chart.views:
            layout = view_layout(chart, view)
            go.Figure(spec).update_layout({k.replace(".", "_"): v for k, v in layout.items()})
        assert chart.title
        assert chart.summary


def test_a_thinned_curve_keeps_every_peak() -> None:
    rng = np.random.default_rng(5)
    time = np.sort(rng.random(50_000))
    values = rng.standard_normal(50_000)
    x, y = thinned(time, values, 1000)
    assert len(x) <= 1002
    assert np.all(np.diff(x) > 0)
    assert (y.min(), y.max()) == (values.min(), values.max())
    for part in np.split(values, 500):  # 50,000 points in 500 parts with two points each
        assert {part.min(), part.max()} <= set(y)
