"""Files and texts of others: never a wait, never more than the limit; shown, never obeyed."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from taction.system.foreign_files import (
    UnusableFileError,
    read_bounded,
    read_ends,
    visible,
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
