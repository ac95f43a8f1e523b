"""Tables on pages of any width: layouts, and cells that are broken only between words."""

from __future__ import annotations

import pytest
from rich.text import Text

from taction.verification.report.fitted_table import broken
from taction.verification.report.tables import make_table, whole
from tests.support.printed import shown_at, words_of

ROWS = (
    ("settling time", "[red]fail[/red]", "131.6 us", "a reason of some words, with 12.5 % in it"),
    ("rise", "pass", "-23.1 k/s", "short"),
)


def table(*, title: str | None = None) -> object:
    titles = (*whole("check", "outcome of it", "value"), "how it was found")
    return make_table(titles, ROWS, title=title, caption="what it is")


@pytest.mark.parametrize("width", [20, 33, 47, 60, 200])
def test_all_words_at_every_width_and_numbers_beside_their_units(width: int) -> None:
    text = shown_at(width, [table(title="A title")])
    assert not words_of(shown_at(300, [table(title="A title")])) - words_of(text)
    for together in ("131.6 us", "-23.1 k/s", "12.5 %"):
        assert together in text
    if width > 20:  # "how it was found" and a value need 25
        assert max(map(len, text.splitlines())) <= width


def test_a_wide_page_has_a_row_in_a_line_and_a_narrow_one_a_list() -> None:
    wide = shown_at(120, [table()]).splitlines()
    assert any("settling time   fail" in line and "12.5 % in it" in line for line in wide)
    narrow = shown_at(34, [table()])
    assert " check             settling time\n outcome of it     fail\n" in narrow


def test_a_word_that_is_longer_than_the_page_stays_whole() -> None:
    name = "a-name-without-any-gap/" * 3
    assert name in shown_at(30, [make_table(("file", "n"), [(name, "1")])])


@pytest.mark.parametrize(
    ("cell", "width", "lines"),
    [
        ("10 pF to 20 pF", 6, ["10 pF", "to", "20 pF"]),
        ("at least 9.5 us", 8, ["at least", "9.5 us"]),
        ("(fragile: or 8.718 us)", 10, ["(fragile:", "or", "8.718 us)"]),
        ("one\ntwo three", 5, ["one", "two", "three"]),
        ("word", 2, ["word"]),
        ("", 3, [""]),
    ],
)
def test_a_cell_is_broken_between_words_only(cell: str, width: int, lines: list[str]) -> None:
    assert [line.plain for line in broken(Text(cell), width)] == lines


def test_a_list_repeats_the_name_that_a_table_leaves_out() -> None:
    rows = (("trapezoidal", "16", "9.65 ms"), ("", "32", "11.1 ms"))
    lines = shown_at(20, [make_table(whole("method", "points", "time"), rows)]).splitlines()
    assert sum(line.split() == ["method", "trapezoidal"] for line in lines) == 2
