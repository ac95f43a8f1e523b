"""Preferred values of IEC 60063, between two ends and of three digits, against its tables."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.netlist_gen.board.bill_of_materials import (
    buyable,
    mantissas,
    nearest,
)

# Every eighth value of E96 and every sixteenth of E192, as the standard's tables print them.
E12 = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2)  # IEC 60063
E96 = [1.00, 1.21, 1.47, 1.78, 2.15, 2.61, 3.16, 3.83, 4.64, 5.62, 6.81, 8.25]
E192_LAST = [8.56, 8.66, 8.76, 8.87, 8.98, 9.09, 9.20, 9.31, 9.42, 9.53, 9.65, 9.76, 9.88]


def test_values_of_the_standard() -> None:
    assert mantissas("E6").tolist() == [1.0, 1.5, 2.2, 3.3, 4.7, 6.8]
    assert mantissas("E12").tolist() == [1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2]
    assert mantissas("E96")[::8].tolist() == E96
    assert mantissas("E192")[-13:].tolist() == E192_LAST
    assert mantissas("E192")[::2].tolist() == mantissas("E96").tolist()
    for value in (2.7, 3.0, 3.3, 3.6, 3.9, 4.3, 4.7, 8.2):  # not where 10^(k/24) would round to
        assert value in mantissas("E24")


@pytest.mark.parametrize("decade", range(-14, 10))
def test_a_preferred_value_is_itself_in_every_decade(decade: int) -> None:
    for series in ("E6", "E12", "E24", "E96", "E192"):
        ohms = np.array([float(f"{m}e{decade}") for m in mantissas(series).tolist()])
        assert np.array_equal(nearest(ohms, series), ohms)


@given(st.floats(1e-3, 1e9), st.sampled_from(["E24", "E96", "E192"]))
def test_no_other_preferred_value_is_nearer_by_ratio(ohms: float, series: str) -> None:
    found = float(nearest(np.array([ohms]), series)[0])
    every = np.outer(10.0 ** np.arange(-4, 11), mantissas(series)).ravel()
    best = float(np.min(np.abs(np.log(every / ohms))))
    assert abs(np.log(found / ohms)) <= best + 1e-12


@pytest.mark.parametrize(
    ("value", "series", "expected"),
    [(5.1e-12, "E12", 4.7e-12), (5.2e-12, "E12", 5.6e-12), (12.345, "exact", 12.3)],
)
def test_the_nearest(value: float, series: str, expected: float) -> None:
    assert buyable(value, series) == expected
