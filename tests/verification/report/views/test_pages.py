"""Charts of every page: what Plotly accepts, and what a thinned curve keeps."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from taction.verification.report.charts import Chart, thinned
from taction.verification.report.renderers.plotly import plotly_spec, view_layout
from tests.support.report_pages import STUDIES, VERDICTS, page

MARKED = "#123456"  # in the place of a colour of the style sheet


def coloured(value: Any) -> Any:
    if isinstance(value, str):
        return MARKED if value.startswith("--") else value
    if isinstance(value, dict):
        return {key: coloured(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [coloured(each) for each in value]
    return value


@pytest.mark.parametrize("name", [*VERDICTS, *STUDIES])
def test_plotly_accepts_every_chart(name: str) -> None:
    import plotly.graph_objects as go

    for chart in (block for block in page(name).blocks() if isinstance(block, Chart)):
        spec = coloured(json.loads(json.dumps(plotly_spec(chart), allow_nan=False)))
        go.Figure(spec)  # raises for an unknown property or value
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
