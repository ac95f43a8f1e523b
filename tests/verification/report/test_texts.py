"""Values and Markdown tables as text; outputs that cannot be written."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from taction.system.errors import InputError
from taction.verification.report.output_checks import check_folder, check_separate
from taction.verification.report.renderers.markdown import table as markdown_table
from taction.verification.report.texts import value_text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (None, "s", "-"),
        (math.nan, "step", "-"),
        (1.5e-5, "s", "15 us"),
        (0.0123, "step", "1.23 %"),
        (-1234.5, "1/s", "-1.234 k/s"),
        (2.0, "ratio", "2"),
        (12345, "", "12345"),
        ("ua741", "", "ua741"),
    ],
)
def test_values_with_their_units(value: float | str | None, unit: str, text: str) -> None:
    assert value_text(value, unit) == text


def test_a_markdown_table_escapes_its_cells_and_keeps_them_in_one_line() -> None:
    lines = list(markdown_table(("a", "b"), [("x | y", "two\nlines")]))
    assert lines == ["| a | b |", "| --- | --- |", "| x \\| y | two\\\\nlines |"]


@pytest.mark.parametrize(("name", "word"), [("missing/x.json", "does not exist"), (".", "folder")])
def test_a_place_that_cannot_be_written_is_named_beforehand(
    tmp_path: Path, name: str, word: str
) -> None:
    with pytest.raises(InputError, match=word):
        check_folder(tmp_path / name, "--junit")


def test_devices_may_be_shared(tmp_path: Path) -> None:
    check_separate([], {"--junit": "/dev/null", "--markdown": "/dev/null"})
    file = str(tmp_path / "a")
    with pytest.raises(InputError, match="the file of --junit of the same command"):
        check_separate([], {"--junit": file, "--markdown": file})
