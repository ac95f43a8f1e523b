"""Values and Markdown tables as text."""

from __future__ import annotations

import math

import pytest

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
    assert lines == ["| a | b |", "| --- | --- |", "| x \\| y | two lines |"]
