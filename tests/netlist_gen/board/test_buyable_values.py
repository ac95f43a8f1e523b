"""Values of series and of three digits between two ends, against the standard's own table."""

from __future__ import annotations

import pytest

from taction.netlist_gen.board.buyable_values import buyable, series_of, values_between
from taction.netlist_gen.scene.design import Design

E12 = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2)  # IEC 60063


def test_a_series_over_two_decades() -> None:
    expected = [*E12[6:], *(10.0 * value for value in E12[:4])]
    assert values_between(3.0, 18.0, "E12").tolist() == pytest.approx(expected, rel=1e-15)


def test_ends_belong_to_the_interval() -> None:
    assert values_between(4.7e-11, 6.8e-11, "E6").tolist() == [4.7e-11, 6.8e-11]


def test_three_digits_without_a_series() -> None:
    assert values_between(0.998, 1.02, "exact").tolist() == [0.998, 0.999, 1.0, 1.01, 1.02]


@pytest.mark.parametrize(
    ("value", "series", "expected"),
    [(5.1e-12, "E12", 4.7e-12), (5.2e-12, "E12", 5.6e-12), (12.345, "exact", 12.3)],
)
def test_the_nearest(value: float, series: str, expected: float) -> None:
    assert buyable(value, series) == expected


def test_the_series_of_a_key() -> None:
    design = Design(resistor_series="E96", capacitor_series="E6")
    paths = ("capacitance", "gain", "unit_voltage")
    assert [series_of(design, f"design.{path}") for path in paths] == ["E6", "E96", "exact"]
