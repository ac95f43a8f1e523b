"""Texts of others are shown, never obeyed."""

from __future__ import annotations

import pytest

from taction.system.foreign_text import LONGEST, escaped, shortened, visible, visible_lines

BACKSLASH = "\\"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain µ Ω", "plain µ Ω"),
        ("a\nb", r"a\nb"),
        ("a\r\tb", r"a\r\tb"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("\x9b2J", r"\x9b2J"),
        ("\u202eevil\u2028", r"\u202eevil\u2028"),
        ("\udcff", r"\udcff"),
        ("::error::x", r"\x3a:error::x"),
        ("  ::error::x", r"  \x3a:error::x"),
        ("a\n::error::x", r"a\n::error::x"),
        ("a::b", "a::b"),
        ("##[error]x", r"\x23#[error]x"),
        ("# [x]", "# [x]"),
        ("", ""),
    ],
)
def test_a_text_is_shown_in_one_printable_line(text: str, shown: str) -> None:
    assert visible(text) == shown
    assert visible(text).isprintable()


def test_of_several_lines_no_one_is_a_command() -> None:
    assert visible_lines("a\n::warning::b\n c") == "a\n" + BACKSLASH + "x3a:warning::b\n c"


def test_what_is_kept_is_kept() -> None:
    assert escaped("a\n\tb\x00", "\n\t") == "a\n\tb" + BACKSLASH + "x00"


@pytest.mark.parametrize("size", [LONGEST, LONGEST + 1, 10**6])
def test_a_long_text_keeps_both_ends(size: int) -> None:
    text = shortened("<" + "x" * (size - 2) + ">")
    assert len(text) <= LONGEST + 5
    assert (text[0], text[-1]) == ("<", ">")
    assert (" ... " in text) == (size > LONGEST)
