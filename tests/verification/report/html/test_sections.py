"""Sections of a report: margins, schematic, stable values of C, tables of studies."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from taction.system.quantities import readable
from taction.verification.report.blocks import PAGE
from taction.verification.report.html.blocks import (
    Bars,
    Block,
    Code,
    Drawing,
    Facts,
    Ranges,
    Report,
    Table,
)
from taction.verification.report.html.sections.board import schematic
from taction.verification.report.html.sections.checks import check_bar
from taction.verification.report.html.texts import figure, quantity
from taction.verification.verdict.board_power import board_power
from tests.support.report_pages import page, verdicts


def block(report: Report, title: str, kind: type[Any] = Table) -> Any:
    found: list[Block] = [b for part in report.sections for b in part.made(PAGE)]
    return next(each for each in found if isinstance(each, kind) and each.title == title)


def check(value: float | None, limit: float | None, **more: Any) -> dict[str, Any]:
    made = {"name": "overshoot", "outcome": "pass", "value": value, "uncertainty": 0.01}
    return made | {"expected": limit, "tolerance": None, "unit": "step", "reason": ""} | more


@pytest.mark.parametrize(
    ("record", "share", "width", "used"),
    [
        (check(0.1, 0.4), 0.25, 50.0, "25 % of the limit"),
        (check(0.8, 0.4), 2.0, 300.0, "200 % of the limit"),
        (check(6.0, 0.4), 15.0, 300.0, "15 times the limit"),
        (check(1e-9, 0.4), 2.5e-9, 0.0, "below 0.01 % of the limit"),
        (check(3.0, 1.5, name="stability", unit="ratio"), 0.5, 100.0, "50 % of the limit"),
        (check(None, 0.4), None, 0.0, "below 0.01 % of the limit"),
        (check(-1e4, 0.0, name="stability", unit="1/s"), None, 0.0, "below 0.01 % of the limit"),
    ],
)
def test_a_bar_is_the_used_part_of_the_limit(
    record: dict[str, Any], share: float | None, width: float, used: str
) -> None:
    bar = check_bar(record)
    assert bar.share == (None if share is None else pytest.approx(share))
    assert bar.width == pytest.approx(width, abs=1e-3)
    assert bar.used == used


def test_a_value_below_the_smallest_one_is_beyond_its_limit() -> None:
    bar = check_bar(check(8e-6, 12e-6, name="rise_time", unit="s", outcome="fail"), 10e-6)
    assert bar.share == pytest.approx(1.25)
    assert bar.limit == "at least 10 µs"


def test_the_whisker_is_the_uncertainty() -> None:
    assert check_bar(check(0.2, 0.4)).whisker == pytest.approx((95.0, 105.0))
    assert check_bar(check(0.2, 0.4, uncertainty=1e-6)).whisker is None


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("passing", ("Rb_", "Rr_2", "Cc_2", "Rs_", "100 kΩ", "100 pF")),
        ("exponential", ("exponential", "Rbias_1", "Ve = ")),
        ("passive", ("Rr_1", "Cc_1", "u_1")),
        ("one channel", ("Rb_1_1", "Rf_1_1", "w_1")),
    ],
)
def test_the_schematic_has_the_parts_of_the_board(name: str, parts: tuple[str, ...]) -> None:
    drawing = schematic(verdicts()[name].circuit)
    root = ElementTree.fromstring(drawing.svg)  # noqa: S314 - made by ourselves
    text = " ".join("".join(each.itertext()) for each in root.iter() if each.tag.endswith("text"))
    for part in parts:
        assert part in text
    assert "script" not in drawing.svg
    assert drawing.summary


def test_every_schematic_is_drawn_inside_its_frame() -> None:
    for verdict in verdicts().values():
        svg = ElementTree.fromstring(schematic(verdict.circuit).svg)  # noqa: S314
        assert len(svg.get("viewBox", "").split()) == 4


def test_the_stable_values_of_c_are_written_beside_the_poles() -> None:
    facts = dict(block(page("oscillating"), "", Facts).rows)
    assert facts["stable values of C"].startswith("above ")
    sections = [part for part in page("oscillating").sections if part.title == "Stability"]
    assert "not stable" in sections[0].lead


def test_the_parts_list_counts_every_part() -> None:
    verdict = verdicts()["passing"]
    rows = block(page("passing"), "Bill of materials").rows
    circuit = verdict.circuit
    resistors = len(circuit.resistors) + sum(
        int(np.isfinite(m.ohms).sum()) for m in circuit.matrices
    )
    counted = sum(row[2].number for row in rows if row[0].text == "resistor")
    assert counted == resistors
    from taction.verification.engines.statespace.linearised.board import LinearBoard

    power = quantity(board_power(LinearBoard(circuit)).total, "W", 3)
    facts = next(p.blocks[0] for p in page("passing").sections if p.title == "Parts list")
    assert isinstance(facts, Facts)
    assert dict(facts.rows)["dissipation at rest"] == power


def test_the_deck_to_copy_is_the_deck_that_runs() -> None:
    code = block(page("passing"), "the deck", Code)
    assert code.text.rstrip().endswith(".end")
    assert ".tran" in code.text


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


def test_a_drawing_and_its_summary_are_in_the_report() -> None:
    drawing = block(page("passing"), "One channel", Drawing)
    assert "<svg" in drawing.svg


def test_values_are_written_as_an_engineer_writes_them() -> None:
    assert readable("0.5 V/us of 10 kohm in 3 us") == "0.5 V/µs of 10 kΩ in 3 µs"
    assert readable("10 uA, usual") == "10 µA, usual"
    assert figure(float("nan"), "s") == "–"
