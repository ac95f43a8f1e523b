"""Files that another program wrote: never a wait, never more than the limit."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from taction.system.foreign_files import UnusableFileError, read_bounded, read_ends


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
