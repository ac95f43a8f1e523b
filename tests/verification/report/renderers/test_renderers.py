"""Every block and chart in every medium, no text over another one, and the files of reports."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import re
from importlib.resources import files
from typing import Any

import numpy as np
import pytest
from lxml import html
from matplotlib.axis import Axis as FigureAxis
from matplotlib.figure import Figure
from matplotlib.text import Text as FigureText

from taction.system.charts import OUTCOMES, Axis, Band, Chart, Columns, Curve, Limit
from taction.verification.report.blocks import (
    Bar,
    Bars,
    Block,
    Cell,
    Code,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.renderers import picture, plotly, terminal
from taction.verification.report.renderers.page import FILES, page_html
from taction.verification.report.renderers.terminal import card
from tests.support import nightly
from tests.support.report_pages import HOSTILE, hostile, page

EVERYWHERE = "terminal page notebook"

TOUCH = 1.0  # pixels by which boxes may overlap: a box is larger than its letters
MOST = 6_000_000  # bytes
DRAWN = ("passing", "64 channels", "tune", "sweep, a map")
DRAWN += tuple(nightly("montecarlo", "accuracy", "choose", "onset"))
SAMPLE = ("passing", "exponential", "64 channels", "sweep, a map", "regress")


TIME, OUTPUT = Axis("time", "s", limits=(0.0, 1e-4)), Axis("output", "V")
CHARTS = {
    "deviation": Chart(
        "Deviation", TIME, Axis("deviation", "step", limits=(-0.06, 0.06)),
        (Band(-0.01, 0.01, "y"), Curve([0.0, 5e-5, 1e-4], [0.05, 0.02, 0.0], "u1")),
        "The deviation in per cent of the step.",
    ),
    "histogram": Chart(
        "Settling time", Axis("settling time", "s", "log"), Axis("samples", whole=True),
        (Columns([1e-5, 2e-5, 3e-5], [4.0, 9.0, 2.0], [1e-5] * 3, ("pass", "pass", "fail")),
         Limit(2.5e-5, "x", "limit")),
        "Fifteen samples.",
    ),
}  # fmt: skip


def gallery() -> Page:
    """Return a page with every block, everywhere."""
    blocks: tuple[Block, ...] = (
        Table(
            "Channels", ("channel", "state", "target", "why"),
            (
                (Cell("u1", 1.0), Cell("settled", None, "pass"), Cell("12.3 µV", 12.3e-6),
                 Cell("")),
                (Cell("u2", 2.0), Cell("grows", None, "fail"), Cell("–"),
                 Cell("a mode grows with 23.1 k/s at 49 kHz")),
            ),
            "in SI units",
        ),
        Bars(
            "Checks",
            (
                Bar("overshoot", "pass", 0.25, 0.02, "10 % ± 1 %", "at most 40 %"),
                Bar("rise time", "fail", 2.0, 0.0, "2 µs", "at most 1 µs", "u1 is slow"),
                Bar("stability", "inconclusive", None, 0.0, "–", "", "a pole is near the axis"),
            ),
        ),
        Facts("Board", (("R", "10 kΩ"), ("channels", "3"))),
        Code("deck", "* a board\nR1 a b 1e4"),
        Notes("Warnings", ("the record ends early",), "fail"),
        *CHARTS.values(),
    )  # fmt: skip
    return Page(
        "gallery", "taction gallery", "fail", "1 of 3 checks fails.", ("3 channels",),
        (Section("Everything", blocks, "Every block.", EVERYWHERE),), ("made in 1 s",),
    )  # fmt: skip


def texts_of(figure: Figure) -> list[tuple[str, Any]]:
    """Return the texts that are seen, with their boxes in pixels."""
    hidden = set()
    for axis in figure.findobj(FigureAxis):
        scale = axis.get_transform().transform
        low, high = sorted(scale(axis.get_view_interval()))
        margin = 1e-6 * (high - low)
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        with np.errstate(divide="ignore", invalid="ignore"):
            places = [float(scale(np.array([tick.get_loc()]))[0]) for tick in ticks]
        inside = [low - margin <= place <= high + margin for place in places]
        outside = [tick for tick, seen in zip(ticks, inside, strict=True) if not seen]
        hidden |= {id(label) for tick in outside for label in (tick.label1, tick.label2)}
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    found = []
    for text in figure.findobj(FigureText):
        axes = text.axes
        shown = text.get_visible() and (axes is None or axes.get_visible())
        if not shown or not text.get_text().strip() or id(text) in hidden:
            continue
        box = text.get_window_extent(renderer)
        if box.width > 0.0 and box.height > 0.0:
            found.append((text.get_text(), box))
    return found


def overlapping(texts: list[tuple[str, Any]]) -> list[tuple[str, str]]:
    """Return pairs of texts that lie over each other, of `texts_of`."""
    found = []
    for k, (first, a) in enumerate(texts):
        for second, b in texts[k + 1 :]:
            width = min(a.x1, b.x1) - max(a.x0, b.x0)
            height = min(a.y1, b.y1) - max(a.y0, b.y0)
            if width > TOUCH and height > TOUCH:
                found.append((first, second))
    return found


def cut_off(figure: Figure, texts: list[tuple[str, Any]]) -> list[str]:
    """Return those of `texts_of` a figure that are not entirely within it."""
    whole = figure.bbox
    return [
        text
        for text, box in texts
        if box.x0 < whole.x0 - TOUCH
        or box.x1 > whole.x1 + TOUCH
        or box.y0 < whole.y0 - TOUCH
        or box.y1 > whole.y1 + TOUCH
    ]


WIDTHS = (40, 60, 80, 100, 120, 160, 200)


def at_width(page: Page, width: int) -> str:
    text = io.StringIO()
    console = terminal.Terminal(file=text)
    console.width = width
    terminal.print_page(page, console)
    return text.getvalue()


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_an_outcome_has_the_same_colour_in_every_medium(outcome: str) -> None:
    look = OUTCOMES[outcome]
    style = (FILES / "page.css").read_text("utf-8")
    assert f"--fill-{outcome}: {look.colour};" in style
    assert picture.colour(outcome) == plotly.colour(outcome) == look.colour
    assert terminal.outcome_text("x", outcome).style == look.colour
    page = Page("title", "study", outcome, "", (), ())
    assert look.colour in terminal.card(page)
    assert f"{look.sign} {outcome}" in terminal.card(page)


@pytest.mark.parametrize("width", WIDTHS)
def test_a_terminal_of_any_width_shows_every_word(width: int) -> None:
    narrow, wide = at_width(gallery(), width), at_width(gallery(), 400)
    missing = set(wide.split()) - set(narrow.split())
    assert not {word for word in missing if "─" not in word}
    assert "…" not in narrow
    rows = [line for line in narrow.splitlines() if "│" in line or "─" in line]
    assert all(len(line) <= width for line in rows)


def test_a_page_has_every_block_and_loads_nothing() -> None:
    tree = html.document_fromstring(page_html(gallery()))
    blocks = gallery().sections[0].made("page")
    assert len(tree.find_class("block")) == len(blocks)
    assert len(tree.find_class("canvas")) == len(CHARTS)
    text = tree.text_content()
    for word in ("12.3 µV", "at most 40 %", "u1 is slow", "10 kΩ", "the record ends early"):
        assert word in text
    assert not tree.xpath("//*[@src or @href[not(starts-with(., '#'))]]")


def test_sections_are_made_only_for_their_media() -> None:
    def refuse() -> tuple[Table, ...]:
        raise AssertionError("a terminal does not need this section")

    page = Page("t", "c", "", "", (), (Section("only the page", refuse, media="page"),))
    assert terminal.page_text(page) == "t"
    assert "only the page" not in terminal.card(page)


def test_plotly_has_the_units_of_the_axes() -> None:
    share, time = (plotly.plotly_spec(CHARTS["deviation"])["layout"][f"{n}axis"] for n in "yx")
    assert share["title"]["text"] == "deviation (% of the step)"
    assert share["range"] == [-6.0, 6.0]
    assert (time["ticksuffix"], time["range"]) == ("s", [0.0, 1e-4])
    log = plotly.plotly_spec(CHARTS["histogram"])["layout"]["xaxis"]
    assert (log["type"], log["title"]["text"]) == ("log", "settling time (s)")


@pytest.mark.parametrize("name", DRAWN)
def test_a_picture_has_no_text_over_another_or_beyond_its_edge(name: str) -> None:
    figure = picture.draw_page(page(name))
    figure.draw_without_rendering()
    texts = texts_of(figure)
    assert not overlapping(texts)
    assert not cut_off(figure, texts)


def test_a_picture_has_the_values_of_the_chart() -> None:
    section = Section("", CHARTS.values(), media="picture")
    axes, hatched = picture.draw_page(Page("", "", sections=(section,))).axes
    curve = next(line for line in axes.lines if len(np.asarray(line.get_xdata())) > 2)
    assert np.allclose(np.asarray(curve.get_ydata())[0], 5.0)
    assert axes.get_ylim() == (-6.0, 6.0)
    assert axes.get_xlabel() == "time"
    assert axes.xaxis.get_major_formatter()(4e-5) == "40 µs"
    looks = [(patch.get_hatch() or "", patch.get_height()) for patch in hatched.patches]
    assert looks == [("", 4.0), ("", 9.0), ("////", 2.0)]


def test_a_wide_table_is_cut_into_parts_that_repeat_the_heads() -> None:
    titles = ("C", "gain", *(f"quantity {k}" for k in range(8)))
    rows = tuple(
        (Cell(f"{n} pF"), Cell(f"{n} kohm"), *(Cell(f"value {k}{n}") for k in range(8)))
        for n in range(10, 20)
    )
    table = Table("", titles, rows, heads=2)
    page = Page("t", "c", "", "", (), (Section("", (table,), "", EVERYWHERE),))
    for width, parts in ((160, 1), (80, 2), (50, 3)):
        lines = at_width(page, width).splitlines()
        assert max(map(len, lines)) <= width
        assert sum("15 pF" in line and "15 kohm" in line for line in lines) == parts


@pytest.mark.parametrize("name", SAMPLE)
def test_a_report_names_nothing_outside_itself_and_is_small(name: str) -> None:
    text = page_html(page(name))
    assert len(text.encode()) < MOST
    tree = html.document_fromstring(text)
    assert not tree.xpath("//*[@src] | //link | //iframe | //object | //*[starts-with(@href, 'h')]")
    assert [a for a in tree.xpath("//@href") if not a.startswith("#")] == []
    style = tree.xpath("string(//style)")
    assert "@import" not in style
    assert re.findall(r"url\((?!#)", style) == []


def test_the_policy_lets_only_the_two_programs_of_the_page_run() -> None:
    tree = html.document_fromstring(page_html(page("passing")))
    (policy,) = tree.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    (program,) = tree.xpath("//script[not(@type)]/text()")
    (packed,) = tree.xpath("//script[@id='plotly']/text()")
    plotly = gzip.decompress(base64.b64decode(packed))
    assert plotly == (files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    for text in (program.encode(), plotly):
        assert base64.b64encode(hashlib.sha256(text).digest()).decode() in policy
    assert "default-src 'none'" in policy
    assert "script-src 'sha256-" in policy
    assert "unsafe-eval" not in policy
    assert "http" not in policy
    assert '"sendChartToCloud"], plotlyServerURL: ""' in program  # no button that uploads a chart


def test_texts_are_never_markup() -> None:
    text = page_html(hostile())
    tree = html.document_fromstring(text)
    assert HOSTILE not in text
    assert HOSTILE not in card(hostile())
    assert "<script>window" not in text
    assert "<img" not in text
    kinds = [each.get("type") or each.get("id") for each in tree.xpath("//script")]
    assert kinds.count(None) == 1
    assert HOSTILE in tree.text_content()
