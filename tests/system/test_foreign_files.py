"""Files and texts of others: never a wait, never more than the limit; shown, never obeyed."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from taction.system.foreign_files import (
    LONGEST,
    UnusableFileError,
    escaped,
    read_bounded,
    read_ends,
    shortened,
    visible,
    visible_lines,
)


def test_a_file_comes_back_whole(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(bytes(range(256)) * 8000)  # more than one piece
    assert read_bounded(file, 3_000_000) == file.read_bytes()
    assert read_bounded(file, 256 * 8000) == file.read_bytes()


def test_a_file_over_the_limit_is_refused_without_being_read(tmp_path: Path) -> None:
    file = tmp_path / "a"
    with file.open("wb") as stream:
        stream.truncate(10**12)  # sparse
    with pytest.raises(UnusableFileError, match=re.escape("over 2 MB, the largest size")):
        read_bounded(file, 2_000_000)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", tmp_path, "/dev/zero", "/dev/null"):
        with pytest.raises(UnusableFileError, match="not a regular file"):
            read_bounded(name, 1000)
    for name, says in ((tmp_path / "missing", "No such file"), ("a\0b", "embedded null")):
        with pytest.raises(UnusableFileError, match=says):
            read_ends(name, 1000)


def test_of_a_long_text_the_ends_are_read(tmp_path: Path) -> None:
    file = tmp_path / "log"
    file.write_text("first\n" + "x" * 10_000 + "\nlast\n")
    assert read_ends(file, 20_000) == file.read_text()
    text = read_ends(file, 100)
    assert text.startswith("first\n")
    assert text.endswith("\nlast\n")
    assert f"... {10_012 - 100} bytes" in text
    assert len(text) < 130


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
