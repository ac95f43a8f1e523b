"""What pages and pictures of studies and of a reproduction show."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.system.charts import Axis, Chart, Curve, Limit, thinned
from taction.system.documents import plain
from taction.verification.evidence.paper import reproduce
from taction.verification.evidence.paper.findings import Chapter, Finding, load_claims
from taction.verification.report.blocks import Bars, Page, Table
from taction.verification.report.renderers.plotly import plotly_spec
from taction.verification.report.views.sweep_view import maps
from tests.support.entries import grid_plan
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

    for each in (block for block in page(name).blocks() if isinstance(block, Chart)):
        spec = coloured(json.loads(json.dumps(plotly_spec(each), allow_nan=False)))
        go.Figure(spec)  # raises for an unknown property or value
        assert each.title
        assert each.summary


def test_a_thinned_curve_keeps_every_peak() -> None:
    rng = np.random.default_rng(5)
    time, values = np.sort(rng.random(50_000)), rng.standard_normal(50_000)
    x, y = thinned(time, values, 1000)
    assert len(x) <= 1002
    assert np.all(np.diff(x) > 0)
    assert (y.min(), y.max()) == (values.min(), values.max())
    for part in np.split(values, 500):  # 50,000 points in 500 parts with two points each
        assert {part.min(), part.max()} <= set(y)


def block(report: Page, title: str, kind: type[Any] = Table) -> Any:
    return next(b for b in report.blocks() if isinstance(b, kind) and b.title == title)


def test_a_value_of_a_corner_is_marked_beyond_its_limit() -> None:
    table = block(page("corners"), "Corners")
    assert {row[1].outcome for row in table.rows} <= {"pass", "fail", "inconclusive"}
    place = table.columns.index("steady state")
    most = re.search(r"steady state at most ([\d.]+) %", table.note)
    assert most is not None
    for row in table.rows:
        assert (row[place].outcome == "fail") is (row[place].number > float(most[1]) / 100.0)


def test_a_regression_marks_what_changed() -> None:
    report = page("regress")
    assert report.outcome == "fail"
    changes = block(report, "Changes")
    assert [row[3].text for row in changes.rows] == ["500 mV"]  # the difference
    assert [row[5].text for row in changes.rows] == ["50"]
    assert isinstance(block(report, "Checks", Bars), Bars)


def _charts(name: str) -> list[Chart]:
    return [each for each in page(name).blocks() if isinstance(each, Chart)]


def test_the_root_locus_passes_the_axis_at_the_crossings() -> None:
    marks = {each.name: each for each in _charts("onset")[0].marks if isinstance(each, Curve)}
    assert np.min(marks["grows"].x) >= 0.0 > np.max(marks["decays"].x)
    rows = block(page("onset"), "Crossings").rows
    assert list(marks["crossing"].y) == [row[1].number for row in rows]
    assert {"C = 1 pF", "C = 100 pF"} <= marks.keys()


def test_what_fails_is_told_apart_by_colour_and_mark() -> None:
    points = [m for m in _charts("sweep, a map")[0].marks if isinstance(m, Curve) and m.name]
    assert {each.name.partition(":")[0] for each in points} == {
        "pass", "fail", "inconclusive", "error"
    }  # fmt: skip
    assert len({(each.colour, each.mark) for each in points}) == len(points)
    assert sum(np.size(each.x) for each in points) == 4 * 3


def test_the_boundary_is_where_the_growth_rate_passes_through_zero() -> None:
    plan = grid_plan("C=10pF:30pF:2:lin", "gain=1k:2k:2:lin")
    rates = {"growth_rate": np.array([[3.0, 3.0], [-1.0, -1.0]])}
    chart = next(maps(plan, rates, (), np.full((2, 2), "pass"), {}))
    assert chart.marks[-1].x[:2] == pytest.approx([25e-12, 25e-12])
    assert "interpolated between the points" in chart.summary


DRAWN = Chart(
    "title",
    Axis("x", scale="log"),
    Axis("y"),
    (Curve([1, 2], [3, 4], "line"), Limit(3.5, "y", "mark: 3.5")),
    "What <is> seen | here.",
)


def chapter() -> Chapter:
    wanted = [claim for claim in load_claims() if claim.chapter == "reconstruction"]
    found = (Finding(c, "run", "a | b <c>", c.expected, {"value": 1.0}) for c in wanted)
    return Chapter(tuple(found), (DRAWN,))


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """One chapter that costs nothing."""
    monkeypatch.setattr(reproduce, "CHAPTERS", {"reconstruction": ("A <title>", chapter)})


@pytest.mark.usefixtures("short")
def test_the_page_holds_every_claim_and_the_pictures(tmp_path: Path) -> None:
    found = reproduce.reproduce()
    found.report(tmp_path / "paper.html")
    html = (tmp_path / "paper.html").read_text("utf-8")
    assert html.count("a | b &lt;c&gt;") == len(found.findings)
    assert html.count('class="canvas"') == 1
    assert "mark: 3.5" in html
    assert "What &lt;is&gt; seen | here." in html
    assert "A &lt;title&gt;" in html
    assert all(each["as_expected"] for each in plain(found)["claims"])
