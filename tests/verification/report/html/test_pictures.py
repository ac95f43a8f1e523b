"""Pictures: what Plotly accepts, what they show, and what they leave out."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from taction.verification.report.blocks import PAGE
from taction.verification.report.charts import Chart
from taction.verification.report.html.blocks import Block, Picture, Report
from taction.verification.report.html.pictures import channel_colours, packed, thinned, words
from taction.verification.report.html.sections.board import LARGEST, matrix_picture
from taction.verification.report.renderers.plotly import plotly_spec, view_layout
from tests.support.report_pages import STUDIES, VERDICTS, page, verdicts

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


def values_of(spec: dict[str, Any]) -> Any:
    return np.frombuffer(base64.b64decode(spec["bdata"]), "<f4")


def luminance(colour: str) -> float:
    """Relative luminance as WCAG 2 defines it."""
    parts = [int(each) / 255 for each in colour[4:-1].split(",")]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


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


def test_the_outputs_show_the_record_and_the_targets() -> None:
    verdict = verdicts()["passing"]
    spec = pictures(page("passing"))["Outputs"].spec
    lines = [trace for trace in spec["data"] if trace["mode"] == "lines"]
    assert [trace["name"] for trace in lines] == ["u1", "u2", "u3"]
    for n, trace in enumerate(lines):
        x, y = values_of(trace["x"]), values_of(trace["y"])
        exact = np.interp(x.astype(float), verdict.waveforms.time, verdict.u[:, n])
        assert np.abs(y - exact).max() < 1e-5 * verdict.measurements.amplitude
        assert (y.min(), y.max()) == pytest.approx(
            (verdict.u[:, n].min(), verdict.u[:, n].max()), rel=1e-6
        )
    heights = {shape["y0"] for shape in spec["layout"]["shapes"] if "y0" in shape}
    assert {channel.target for channel in verdict.measurements.channels} <= heights


def test_symmetric_channels_differ_in_their_lines_and_share_a_name() -> None:
    spec = pictures(page("passing"))["Outputs"].spec
    dashes = {trace["name"]: trace["line"]["dash"] for trace in spec["data"] if "line" in trace}
    assert dashes["u1"] != dashes["u3"]
    texts = [note["text"] for note in spec["layout"]["annotations"]]
    assert "u1, u3" in texts


def test_a_growing_record_ends_at_the_supply() -> None:
    verdict = verdicts()["oscillating"]
    picture = pictures(page("oscillating"))["Outputs"]
    low, high = picture.spec["layout"]["yaxis"]["range"]
    assert max(-low, high) < 2 * verdict.circuit.supply
    assert np.abs(verdict.u).max() <= max(-low, high) or "beyond it" in picture.summary


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


def test_the_colours_of_channels_are_seen_on_both_papers() -> None:
    for colour in channel_colours(64):
        level = luminance(colour)
        assert (1.0 + 0.05) / (level + 0.05) > 3.0  # white
        assert (level + 0.05) / (0.011 + 0.05) > 3.0  # the dark card
    assert len(set(channel_colours(8))) == 8


def test_a_large_matrix_keeps_its_largest_entries() -> None:
    from dataclasses import replace

    circuit = verdicts()["one channel"].circuit
    rng = np.random.default_rng(6)
    T = rng.standard_normal((500, 300))
    G0 = circuit.value("G0")
    forward = replace(circuit.forward, ohms=1.0 / (G0 * np.abs(T)), negative=T < 0)
    picture = matrix_picture(replace(circuit, matrices=(forward, circuit.feedback)))
    z = np.array(picture.spec["data"][0]["z"])
    assert max(z.shape) <= LARGEST
    assert np.abs(z).max() == pytest.approx(1.0)
    assert np.sign(z[0, 0]) == np.sign(T[:4, :4].flat[np.abs(T[:4, :4]).argmax()])
    assert "500 by 300" in picture.summary


def test_the_waterfall_adds_up_in_the_worst_channel() -> None:
    budget = verdicts()["passing"].budget
    assert budget.total is not None
    worst = int(np.argmax(np.abs(budget.total.channels)))
    (bars,) = pictures(page("passing"))["Waterfall"].spec["data"]
    *steps, total = bars["x"]
    *bases, zero = bars["base"]
    assert total == pytest.approx(budget.total.channels[worst])
    assert zero == 0.0
    assert bases[0] == 0.0
    assert bases[1:] == pytest.approx([b + s for b, s in zip(bases, steps, strict=True)][:-1])
    assert bases[-1] + steps[-1] == pytest.approx(total, rel=1e-9)
    assert "Not known: ill posedness" in pictures(page("one channel"))["Waterfall"].summary


def test_numbers_and_words() -> None:
    assert np.array_equal(values_of(packed([1.5, -2.0])), [1.5, -2.0])
    assert words("<b>a</b>") == "&lt;b&gt;a&lt;/b&gt;"
