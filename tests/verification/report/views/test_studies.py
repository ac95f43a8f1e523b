"""Sections of a report: margins, schematic, stable values of C, tables of studies."""

from __future__ import annotations

from typing import Any

from taction.system.quantities import readable
from taction.verification.report.blocks import (
    PAGE,
    Bars,
    Block,
    Page,
    Ranges,
    Table,
)
from taction.verification.report.texts import figure
from tests.support.report_pages import page


def block(report: Page, title: str, kind: type[Any] = Table) -> Any:
    found: list[Block] = [b for part in report.sections for b in part.made(PAGE)]
    return next(each for each in found if isinstance(each, kind) and each.title == title)


def test_the_yield_has_its_interval_and_limits() -> None:
    report = page("montecarlo")
    ranges = block(report, "5th percentile, median and 95th percentile against the limits", Ranges)
    for row in ranges.rows:
        assert 0.0 <= row.low <= row.middle <= row.high <= 1.0
        assert all(0.0 <= place <= 1.0 for place in row.limits)
    steady = next(row for row in ranges.rows if row.name == "steady state")
    assert steady.outcome == "fail"
    assert "95 % interval" in report.summary


def test_the_corners_have_least_typical_and_largest_values() -> None:
    (ranges,) = (b for s in page("corners").sections for b in s.made(PAGE) if isinstance(b, Ranges))
    for row in ranges.rows:
        assert row.low <= row.middle <= row.high
    table = block(page("corners"), "Corners")
    assert {row[1].outcome for row in table.rows} <= {"pass", "fail", "inconclusive"}


def test_a_regression_marks_what_changed() -> None:
    report = page("regress")
    assert report.outcome == "fail"
    changes = block(report, "Changes")
    assert [row[4].text for row in changes.rows] == ["50"]
    assert isinstance(block(report, "Checks", Bars), Bars)


def test_values_are_written_as_an_engineer_writes_them() -> None:
    assert readable("0.5 V/us of 10 kohm in 3 us") == "0.5 V/µs of 10 kΩ in 3 µs"
    assert readable("10 uA, usual") == "10 µA, usual"
    assert figure(float("nan"), "s") == "–"
