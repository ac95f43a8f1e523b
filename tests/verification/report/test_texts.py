"""Values and Markdown tables as text; outputs that cannot be written."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from taction.system.errors import InputError
from taction.verification.report.output_checks import check_folder, check_separate
from taction.verification.report.renderers.markdown import table as markdown_table
from taction.verification.report.texts import KNOWN, value_text, with_error
from taction.verification.report.views.checks import check_bar
from taction.verification.report.views.difference import allowed_cell
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.compare import Difference


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


@pytest.mark.parametrize("value", [1.0, 3.2e-9, -4.7e5])
def test_a_bound_is_written_down_to_1_ppm_and_never_as_a_smaller_unit(value: float) -> None:
    """What has no bound behind it is known as well as `KNOWN` says, or says that it is not."""
    assert "1 ppm" in KNOWN
    for share, shown in ((1e-3, True), (2e-6, True), (9e-7, False), (1e-13, False), (0.0, False)):
        text = with_error(value, share * abs(value), "s")
        assert ("±" in text) is shown, (share, text)
    assert with_error(value, None, "s").endswith("± unknown")
    assert with_error(value, math.inf, "s").endswith("± unknown")
    check = Check("rise_time", Outcome.PASS, value, 1e-10 * abs(value), None, None, "s", "")
    assert "±" not in check_bar(check).value


@pytest.mark.parametrize(("allowed", "text"), [(2.1e-17, "1 ppm or better"), (1e-8, "10 ns")])
def test_a_difference_within_tiny_bounds_has_no_attoseconds(allowed: float, text: str) -> None:
    one, other = 1e-5, 1.1e-5
    shown = Difference("checks", "x", None, one, other, "s", other - one, allowed, 1.0, "")
    assert allowed_cell(shown).text == text


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
