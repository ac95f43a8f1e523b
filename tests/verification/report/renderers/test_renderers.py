"""Every block and every kind of chart in every medium; no text of a picture over another one."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from lxml import html

from taction.system.charts import (
    OUTCOMES,
)
from taction.verification.report.blocks import Cell, Page, Section, Table
from taction.verification.report.renderers import notebook, picture, plotly, terminal
from taction.verification.report.renderers.page import FILES, page_html
from taction.verification.report.renderers.picture import new_figure
from tests.support.gallery import EVERYWHERE, charts, drawn_blocks, gallery
from tests.support.printed import words_of
from tests.support.text_boxes import cut_off, overlapping, texts_of

CHARTS = charts()
WIDTHS = (40, 60, 80, 100, 120, 160, 200)


def at_width(page: Page, width: int) -> str:
    text = io.StringIO()
    console = terminal.Terminal(file=text)
    console.width = width
    terminal.print_page(page, console)
    return text.getvalue()


def luminance(colour: str) -> float:
    """Return the relative luminance of a colour, by the definition of WCAG 2."""
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_an_outcome_has_the_same_colour_in_every_medium(outcome: str) -> None:
    look = OUTCOMES[outcome]
    style = (FILES / "page.css").read_text("utf-8")
    assert f"--fill-{outcome}: {look.colour};" in style
    assert picture.colour(outcome) == plotly.colour(outcome) == look.colour
    assert terminal.outcome_text("x", outcome).style == look.colour
    page = Page("title", "study", outcome, "", (), ())
    assert look.colour in notebook.card(page)
    assert f"{look.sign} {outcome}" in notebook.card(page)


@pytest.mark.parametrize("width", WIDTHS)
def test_a_terminal_of_any_width_shows_every_word(width: int) -> None:
    narrow, wide = at_width(gallery(), width), at_width(gallery(), 400)
    missing = set(words_of(wide)) - set(words_of(narrow))
    assert not {word for word in missing if not word.startswith("─")}
    rows = [line for line in narrow.splitlines() if "│" in line or "─" in line]
    assert all(len(line) <= width for line in rows)


def test_a_terminal_binds_numbers_to_their_units() -> None:
    cells = tuple(Cell(f"{k}.5 µs after {k} pF") for k in range(1, 5))
    page = Page(
        "t", "c", "", "", (), (Section("", (Table("", ("a",) * 4, (cells,)),), "", EVERYWHERE),)
    )
    for width in range(20, 100):
        for line in at_width(page, width).splitlines():
            assert not re.search(
                r"(^|\s)(us|pF)\b", line.replace("5 us", "").replace(" pF", "pF", 4)[:3]
            )
    assert "1.5 us" in at_width(page, 40)


def test_a_page_has_every_block_and_loads_nothing() -> None:
    tree = html.document_fromstring(page_html(gallery()))
    blocks = gallery().sections[0].made("page")
    assert len(tree.find_class("block")) == len(blocks)
    assert len(tree.find_class("canvas")) == len(CHARTS)
    text = tree.text_content()
    for word in (
        "12.3 µV",
        "at most 40 %",
        "u1 is slow",
        "10 kΩ",
        "the record ends early",
        "a cell",
    ):
        assert word in text
    assert not tree.xpath("//*[@src or @href[not(starts-with(., '#'))]]")


def test_sections_are_made_only_for_their_media() -> None:
    def refuse() -> tuple[Table, ...]:
        raise AssertionError("a terminal does not need this section")

    page = Page("t", "c", "", "", (), (Section("only the page", refuse),))
    assert terminal.page_text(page) == "t"
    assert "only the page" not in notebook.card(page)


def test_plotly_has_the_units_of_the_axes() -> None:
    share = plotly.plotly_spec(CHARTS["deviation"])["layout"]["yaxis"]
    assert share["title"]["text"] == "deviation (% of the step)"
    assert share["range"] == [-6.0, 6.0]
    log = plotly.plotly_spec(CHARTS["work"])["layout"]["xaxis"]
    assert (log["type"], log["title"]["text"]) == ("log", "wall time (s)")
    time = plotly.plotly_spec(CHARTS["waveforms"])["layout"]["xaxis"]
    assert (time["ticksuffix"], time["range"]) == ("s", [0.0, 5e-5])


def test_a_picture_has_no_text_over_another_or_beyond_its_edge() -> None:
    figure = picture.draw_blocks("gallery: every chart", drawn_blocks(), "grey: no value")
    figure.draw_without_rendering()
    texts = texts_of(figure)
    assert not overlapping(texts)
    assert not cut_off(figure, texts)


def test_a_picture_has_the_values_of_the_chart() -> None:
    with new_figure(5.0, 4.0) as figure:
        axes = figure.add_subplot()
        picture.draw_chart(axes, CHARTS["deviation"])
        curve = next(line for line in axes.lines if len(line.get_xdata()) > 2)
        assert np.allclose(np.asarray(curve.get_ydata())[0], 5.0)
        assert axes.get_ylim() == (-6.0, 6.0)
        assert axes.get_xlabel() == "time"
        assert axes.xaxis.get_major_formatter()(4e-5) == "40 µs"
        hatched = figure.add_subplot()
        picture.draw_chart(hatched, CHARTS["histogram"])
        looks = [(patch.get_hatch(), patch.get_height()) for patch in hatched.patches]
    assert [height for _, height in looks] == [4.0, 9.0, 2.0]
    assert [hatch or "" for hatch, _ in looks] == ["", "", "////"]


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
    assert at_width(page, 20).count("15 pF") == 1  # a list
